#include "bench/load/site.hpp"

#include <charconv>
#include <fstream>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"

namespace gantry::bench {

using namespace std::chrono_literals;

Site::Site(std::string program, bool tag_read, const std::string& more) : program_(std::move(program)) {
    std::ofstream config(dir_.path() / "gantry.toml");
    // Tags that are between two measurements shall not be lost; the API must not meet another gateway's.
    config << fmt::format(R"([gateway]
id = "bench"
data_dir = "{}"
[[reader]]
name = "r-*"
address = "silion-listen://127.0.0.1:0"
[presence]
lose_after = "1h"
[events]
tag_read = {}
[api]
listen = "127.0.0.1:0"
{})",
                          (dir_.path() / "data").string(), tag_read, more);
    if (!config.flush()) throw Failure(fmt::format("cannot write into {}", dir_.path().string()));
}

void Site::start() {
    auto before = std::chrono::steady_clock::now();
    try {
        gateway_ = std::make_unique<Child>(
            std::vector<std::string>{program_, "run", "-c", (dir_.path() / "gantry.toml").string()},
            (dir_.path() / "log").string());
        auto line = gateway_->line("listening on ", 30s);
        auto digits = std::string_view(line).substr(line.rfind(':') + 1);
        std::from_chars(digits.data(), digits.data() + digits.size(), port_);
        gateway_->line("ready", 30s);
    } catch (const Failure& failure) {
        throw Failure(fmt::format("the gateway did not start: {}\n{}", failure.what(), log_end()));
    }
    ready_ms_ = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - before).count();
}

void Site::stop() {
    if (int code = gateway_->stop(); code != 0)
        throw Failure(fmt::format("the gateway ended with {}\n{}", code, log_end()));
}

std::string Site::log_end() const {
    std::ifstream in(dir_.path() / "log");
    std::string log((std::istreambuf_iterator<char>(in)), {});
    constexpr std::size_t shown = 1000;
    return log.size() > shown ? "…" + log.substr(log.size() - shown) : log;
}

}  // namespace gantry::bench
