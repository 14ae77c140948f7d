#include "gateway/dialler.hpp"

#include <fmt/format.h>

#include "base/log.hpp"
#include "link/serial.hpp"

namespace gantry::gateway {

namespace {
constexpr auto dial_timeout = 5s;
}  // namespace

Dialler::Dialler(link::Loop& loop, const ReaderConfig& reader, std::uint64_t seed, Opened opened)
    : loop_(loop), reader_(reader), opened_(std::move(opened)), backoff_(500ms, 30s, seed), timer_(loop) {}
Dialler::~Dialler() = default;

void Dialler::start() {
    open();
}

void Dialler::open() {
    next_try_.reset();
    if (reader_.address.scheme->kind == LinkKind::serial) return open_serial();
    dial_ = link::Dial::start(loop_, {reader_.address.host, reader_.address.port}, dial_timeout,
                              [this](Result<link::Socket> socket) {
                                  dial_.reset();
                                  taken(std::move(socket));
                              });
}

void Dialler::open_serial() {
    auto settings = link::parse_serial(reader_.address.path, reader_.address.options);
    if (!settings) return taken(tl::unexpected(settings.error()));
    taken(link::open_serial(*settings));
}

void Dialler::taken(Result<link::Socket> socket) {
    if (socket) {
        connected_ = true;
        trouble_.clear();
        opened_(std::move(*socket));
        return;
    }
    // The address stands beside the state wherever that is shown.
    auto prefix = fmt::format("cannot connect to {}: ",
                              link::to_text(link::Endpoint{reader_.address.host, reader_.address.port}));
    trouble_ = socket.error().what.starts_with(prefix)
                   ? "cannot connect: " + socket.error().what.substr(prefix.size())
                   : socket.error().what;
    wait();
    if (is_new_trouble())
        log::warn("readers", "{}: {} (tried again, at least every 40 s)", reader_.name,
                  socket.error().text());
}

// Once for each reason: a reader that is switched off for a week must not fill the log.
bool Dialler::is_new_trouble() {
    constexpr std::size_t most_said = 16;
    return said_.size() < most_said && said_.insert(trouble_).second;
}

void Dialler::ended(bool answered, bool lasted, std::string_view reason) {
    connected_ = false;
    if (lasted) backoff_.reset();
    trouble_ = reason.empty() ? "disconnected" : fmt::format("disconnected: {}", reason);
    wait();
    if (answered)
        said_.clear();  // the end of that is in the log already
    else if (is_new_trouble())
        log::warn("readers",
                  "{}: it takes the connection and says nothing; {} (tried again, at least every 40 s)",
                  reader_.name, reason);
}

void Dialler::wait() {
    next_try_ = link::read_clocks().steady + backoff_.next();
    timer_.at(*next_try_, [this] { open(); });
}

std::string Dialler::state(Steady now) const {
    if (connected_ || (!next_try_ && trouble_.empty())) return "connecting";
    if (!next_try_) return trouble_ + "; trying again";
    auto left = std::max(std::chrono::ceil<std::chrono::seconds>(*next_try_ - now), 1s);
    return fmt::format("{}; next try in {}", trouble_, approximate(left));
}

}  // namespace gantry::gateway
