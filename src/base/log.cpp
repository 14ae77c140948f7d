#include "base/log.hpp"

#include <unistd.h>

#include <atomic>
#include <mutex>

#include <spdlog/logger.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/stdout_sinks.h>

#include "base/text.hpp"

namespace gantry::log {

namespace {
std::atomic<Level> threshold{Level::info};
std::mutex mutex;
std::shared_ptr<spdlog::logger> logger;  // made on first use, so that a library user need not call start()
bool as_json = false;
std::string* captured = nullptr;

std::string_view name_of(Level level) {
    switch (level) {
        case Level::debug:
            return "debug";
        case Level::info:
            return "info";
        case Level::warn:
            return "warn";
        default:
            return "error";
    }
}

spdlog::level::level_enum native(Level level) {
    switch (level) {
        case Level::debug:
            return spdlog::level::debug;
        case Level::info:
            return spdlog::level::info;
        case Level::warn:
            return spdlog::level::warn;
        default:
            return spdlog::level::err;
    }
}

void make_logger(Format format) {
    as_json = format == Format::json || (format == Format::automatic && isatty(STDERR_FILENO) == 0);
    if (as_json) {
        logger =
            std::make_shared<spdlog::logger>("gantry", std::make_shared<spdlog::sinks::stderr_sink_st>());
        logger->set_pattern("%v");
    } else {
        logger = std::make_shared<spdlog::logger>("gantry",
                                                  std::make_shared<spdlog::sinks::stderr_color_sink_st>());
        logger->set_pattern("%H:%M:%S.%e %^%-5l%$ %v");
    }
    logger->set_level(spdlog::level::debug);
    logger->flush_on(spdlog::level::debug);
}
}  // namespace

void start(Level level, Format format) {
    std::lock_guard lock(mutex);
    threshold = level;
    make_logger(format);
}

bool enabled(Level level) {
    return level >= threshold.load(std::memory_order_relaxed);
}

void write(Level level, std::string_view module, std::string_view message) {
    if (!enabled(level)) return;
    std::lock_guard lock(mutex);
    if (captured != nullptr) {
        captured->append(fmt::format("{} {} {}\n", name_of(level), module, message));
        return;
    }
    if (!logger) make_logger(Format::automatic);
    if (as_json) {
        auto now = std::chrono::floor<std::chrono::milliseconds>(spdlog::log_clock::now());
        auto ms = now.time_since_epoch().count() % 1000;
        auto seconds = std::chrono::system_clock::to_time_t(now);
        std::tm utc{};
        gmtime_r(&seconds, &utc);
        char stamp[24];
        auto size = std::strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%S", &utc);
        auto line = fmt::format(R"({{"time":"{}.{:03}Z","level":"{}","module":"{}","message":)",
                                std::string_view(stamp, size), ms, name_of(level), module);
        append_json_string(line, message);
        line += '}';
        logger->log(native(level), spdlog::string_view_t(line.data(), line.size()));
    } else {
        auto line = fmt::format("{}: {}", module, message);
        logger->log(native(level), spdlog::string_view_t(line.data(), line.size()));
    }
}

Capture::Capture() {
    std::lock_guard lock(mutex);
    captured = new std::string;
}

Capture::~Capture() {
    std::lock_guard lock(mutex);
    delete captured;
    captured = nullptr;
}

std::string Capture::take() {
    std::lock_guard lock(mutex);
    return std::exchange(*captured, {});
}

}  // namespace gantry::log
