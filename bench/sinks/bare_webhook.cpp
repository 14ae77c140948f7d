#include <curl/curl.h>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"

namespace gantry::bench {

namespace {
// A POST a batch over one connection.
class BareWebhook final : public BareClient {
public:
    explicit BareWebhook(const std::string& url) : handle_(curl_easy_init()) {
        if (handle_ == nullptr) throw Failure("bare webhook: no client");
        headers_ = curl_slist_append(nullptr, "Content-Type: application/json");
        headers_ = curl_slist_append(headers_, "Expect:");
        curl_easy_setopt(handle_, CURLOPT_URL, url.c_str());
        curl_easy_setopt(handle_, CURLOPT_HTTPHEADER, headers_);
        curl_easy_setopt(handle_, CURLOPT_NOSIGNAL, 1L);
        curl_easy_setopt(
            handle_, CURLOPT_WRITEFUNCTION,
            +[](char*, std::size_t size, std::size_t count, void*) { return size * count; });
    }
    ~BareWebhook() override {
        curl_easy_cleanup(handle_);
        curl_slist_free_all(headers_);
    }

    void deliver(std::span<const sink::Item> batch) override {
        body_ = '[';
        for (auto& item : batch) {
            if (body_.size() > 1) body_ += ',';
            body_ += item.payload;
        }
        body_ += ']';
        curl_easy_setopt(handle_, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(body_.size()));
        curl_easy_setopt(handle_, CURLOPT_POSTFIELDS, body_.data());
        auto code = curl_easy_perform(handle_);
        long status = 0;
        curl_easy_getinfo(handle_, CURLINFO_RESPONSE_CODE, &status);
        if (code != CURLE_OK || status != 200)
            throw Failure(fmt::format("bare webhook: {}, status {}", curl_easy_strerror(code), status));
    }

private:
    CURL* handle_;
    curl_slist* headers_ = nullptr;
    std::string body_;
};
}  // namespace

std::unique_ptr<BareClient> bare_webhook(const std::string& place) {
    return std::make_unique<BareWebhook>(place);
}

}  // namespace gantry::bench
