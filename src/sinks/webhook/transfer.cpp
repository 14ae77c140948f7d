#include "sinks/webhook/transfer.hpp"

#include <curl/curl.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <new>
#include <system_error>
#include <utility>

#include "base/text.hpp"

namespace gantry::sinks::webhook {

// What we read of an answer: enough for any receiver, and no more whatever it sends.
static constexpr std::size_t most_headers = 64 * 1024, most_body = 64 * 1024, most_kept = 8 * 1024;

namespace handles {
struct FreeEasy {
    void operator()(CURL* easy) const { ::curl_easy_cleanup(easy); }
};
struct FreeMulti {
    void operator()(CURLM* multi) const { ::curl_multi_cleanup(multi); }
};
struct FreeList {
    void operator()(curl_slist* list) const { ::curl_slist_free_all(list); }
};
struct FreeUrl {
    void operator()(CURLU* url) const { ::curl_url_cleanup(url); }
};
}  // namespace handles

struct Transfer::Impl {
    Connection connection;
    std::unique_ptr<CURLM, handles::FreeMulti> multi;
    std::unique_ptr<CURL, handles::FreeEasy> easy;
    Answer answer;
    std::size_t header_bytes = 0, body_bytes = 0;
    bool headers_whole = false;
    std::array<char, CURL_ERROR_SIZE> error{};

    template <class Value>
    void set(CURLoption option, Value value) {
        ::curl_easy_setopt(easy.get(), option, value);
    }
    void set_file(CURLoption option, const std::string& path) {
        if (!path.empty()) set(option, path.c_str());
    }

    void prepare(const Request& request, curl_slist* headers);
    void finish(CURLcode result);
    bool take_header(std::string_view line);
    bool take_body(std::string_view bytes);
    static std::size_t on_header(char* data, std::size_t one, std::size_t size, void* self);
    static std::size_t on_body(char* data, std::size_t one, std::size_t size, void* self);
};

Transfer::Transfer(Connection connection) : impl_(std::make_unique<Impl>()) {
    static const auto ready = ::curl_global_init(CURL_GLOBAL_DEFAULT);
    impl_->connection = std::move(connection);
    impl_->multi.reset(::curl_multi_init());
    impl_->easy.reset(::curl_easy_init());
    if (ready != CURLE_OK || !impl_->multi || !impl_->easy) throw std::bad_alloc();
}

Transfer::~Transfer() = default;

void Transfer::Impl::prepare(const Request& request, curl_slist* headers) {
    ::curl_easy_reset(easy.get());  // of its options; connections stay
    answer = {};
    header_bytes = body_bytes = 0;
    headers_whole = false;
    error.front() = '\0';
    set(CURLOPT_URL, request.url.empty() ? connection.url.c_str() : request.url.c_str());
    set(CURLOPT_PROTOCOLS_STR, "http,https");
    set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
    set(CURLOPT_NOSIGNAL, 1L);
    set(CURLOPT_QUICK_EXIT, 1L);  // a name that is being looked up holds nobody back
    set(CURLOPT_ERRORBUFFER, error.data());
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(connection.connect_timeout.count()));
    set(CURLOPT_TCP_KEEPALIVE, 1L);
    set(CURLOPT_UPLOAD_BUFFERSIZE, 512L * 1024);  // a batch in one or two pieces
    set(CURLOPT_PROXY, connection.proxy.c_str());
    set(CURLOPT_HTTPHEADER, headers);
    set(CURLOPT_SSLVERSION, static_cast<long>(CURL_SSLVERSION_TLSv1_2));
    set(CURLOPT_SSL_VERIFYPEER, connection.insecure ? 0L : 1L);
    set(CURLOPT_SSL_VERIFYHOST, connection.insecure ? 0L : 2L);
    set_file(CURLOPT_CAINFO, connection.ca);
    set_file(CURLOPT_SSLCERT, connection.certificate);
    set_file(CURLOPT_SSLKEY, connection.key.empty() ? connection.certificate : connection.key);
    if (request.method == "POST") {
        set(CURLOPT_POST, 1L);
        set(CURLOPT_POSTFIELDS, request.body.data());
        set(CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(request.body.size()));
    } else {
        set(CURLOPT_CUSTOMREQUEST, std::string(request.method).c_str());
    }
    set(CURLOPT_HEADERFUNCTION, &Impl::on_header);
    set(CURLOPT_HEADERDATA, this);
    set(CURLOPT_WRITEFUNCTION, &Impl::on_body);
    set(CURLOPT_WRITEDATA, this);
}

Answer Transfer::exchange(const Request& request, const sink::Patience& patience) {
    auto& impl = *impl_;
    std::unique_ptr<curl_slist, handles::FreeList> headers;
    for (auto& line : request.headers) {
        auto* longer = ::curl_slist_append(headers.get(), line.c_str());
        if (longer == nullptr) throw std::bad_alloc();
        static_cast<void>(headers.release());
        headers.reset(longer);
    }
    impl.prepare(request, headers.get());
    ::curl_multi_add_handle(impl.multi.get(), impl.easy.get());
    {
        std::stop_callback wake(patience.stop, [&] { ::curl_multi_wakeup(impl.multi.get()); });
        for (;;) {
            int running = 0;
            auto result = ::curl_multi_perform(impl.multi.get(), &running);
            if (result != CURLM_OK) {
                impl.answer.error = ::curl_multi_strerror(result);
                break;
            }
            if (int left = 0; auto* message = ::curl_multi_info_read(impl.multi.get(), &left)) {
                impl.finish(message->data.result);
                break;
            }
            auto now = std::chrono::steady_clock::now();
            if (patience.over(now)) {
                impl.answer.end =
                    patience.stop.stop_requested() ? Answer::End::stopped : Answer::End::out_of_time;
                break;
            }
            auto left = std::min(std::chrono::ceil<std::chrono::milliseconds>(patience.until - now), 1000ms);
            ::curl_multi_poll(impl.multi.get(), nullptr, 0, static_cast<int>(left.count()), nullptr);
        }
    }
    ::curl_multi_remove_handle(impl.multi.get(), impl.easy.get());  // closes what is not finished
    return std::move(impl.answer);
}

void Transfer::Impl::finish(CURLcode result) {
    long status = 0;
    ::curl_easy_getinfo(easy.get(), CURLINFO_RESPONSE_CODE, &status);
    answer.status = static_cast<int>(status);
    const char* redirect = nullptr;
    ::curl_easy_getinfo(easy.get(), CURLINFO_REDIRECT_URL, &redirect);
    if (redirect != nullptr) answer.redirect = redirect;
    // A body beyond the bound was ended by us, and says no more than the status did.
    if (headers_whole && (result == CURLE_OK || (result == CURLE_WRITE_ERROR && body_bytes > most_body))) {
        answer.end = Answer::End::answered;
        return;
    }
    if (result == CURLE_OK) {  // to libcurl the end of a connection is the end of headers, too
        answer.error = "the connection was closed in the middle of the answer";
        return;
    }
    answer.error = error.front() != '\0' ? error.data() : ::curl_easy_strerror(result);
    long number = 0;
    ::curl_easy_getinfo(easy.get(), CURLINFO_OS_ERRNO, &number);
    if (result == CURLE_COULDNT_CONNECT && number != 0)
        answer.error += ": " + std::generic_category().message(static_cast<int>(number));
    if (result == CURLE_WRITE_ERROR) answer.error = "its headers are longer than any that make sense";
    answer.broken = result == CURLE_SEND_ERROR || result == CURLE_RECV_ERROR;
    answer.untrusted = result == CURLE_PEER_FAILED_VERIFICATION;
}

bool Transfer::Impl::take_header(std::string_view line) {
    header_bytes += line.size();
    if (header_bytes > most_headers) return false;
    headers_whole = trimmed(line).empty();
    if (line.starts_with("HTTP/")) {  // of each answer anew, the 1xx ones included
        answer.retry_after.clear();
        answer.date.clear();
        auto code = line.find(' '), text = code == std::string_view::npos ? code : line.find(' ', code + 1);
        answer.reason =
            text == std::string_view::npos ? std::string() : std::string(trimmed(line.substr(text)));
        return true;
    }
    auto colon = line.find(':');
    if (colon == std::string_view::npos) return true;
    auto name = line.substr(0, colon);
    std::string value(trimmed(line.substr(colon + 1)));
    if (alike(name, "Retry-After"))
        answer.retry_after = std::move(value);
    else if (alike(name, "Date"))
        answer.date = std::move(value);
    return true;
}

bool Transfer::Impl::take_body(std::string_view bytes) {
    body_bytes += bytes.size();
    answer.body += bytes.substr(0, most_kept - std::min(most_kept, answer.body.size()));
    return body_bytes <= most_body;
}

std::size_t Transfer::Impl::on_header(char* data, std::size_t one, std::size_t size, void* self) {
    return static_cast<Impl*>(self)->take_header({data, one * size}) ? one * size : 0;
}

std::size_t Transfer::Impl::on_body(char* data, std::size_t one, std::size_t size, void* self) {
    return static_cast<Impl*>(self)->take_body({data, one * size}) ? one * size : 0;
}

static std::string part_of(CURLU* url, CURLUPart part, unsigned flags = 0) {
    char* text = nullptr;
    if (::curl_url_get(url, part, &text, flags) != CURLUE_OK || text == nullptr) return {};
    std::string out(text);
    ::curl_free(text);
    return out;
}

std::optional<Url> parse_url(const std::string& text) {
    std::unique_ptr<CURLU, handles::FreeUrl> url(::curl_url());
    if (text.find('\0') != std::string::npos || !url ||
        ::curl_url_set(url.get(), CURLUPART_URL, text.c_str(), 0) != CURLUE_OK)
        return {};
    auto small = [](std::string word) {
        std::ranges::transform(word, word.begin(),
                               [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
        return word;
    };
    Url out{.scheme = small(part_of(url.get(), CURLUPART_SCHEME)),
            .host = small(part_of(url.get(), CURLUPART_HOST)),
            .has_password = !part_of(url.get(), CURLUPART_USER).empty() ||
                            !part_of(url.get(), CURLUPART_PASSWORD).empty()};
    for (auto part : {CURLUPART_USER, CURLUPART_PASSWORD, CURLUPART_QUERY, CURLUPART_FRAGMENT})
        ::curl_url_set(url.get(), part, nullptr, 0);
    out.shown = printable(part_of(url.get(), CURLUPART_URL));
    return out;
}

std::optional<Wall> parse_http_date(const std::string& text) {
    constexpr std::int64_t end_of_9999 = 253'402'300'799;  // what a peer says may be beyond all that we count
    auto seconds = static_cast<std::int64_t>(::curl_getdate(text.c_str(), nullptr));
    if (seconds < 0 || seconds > end_of_9999) return {};
    return from_us(seconds * 1'000'000);
}

}  // namespace gantry::sinks::webhook
