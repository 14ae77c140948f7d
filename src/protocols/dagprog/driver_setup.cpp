#include "protocols/dagprog/driver_setup.hpp"

#include <fmt/format.h>

namespace gantry::dagprog {

static std::optional<std::uint32_t> wanted_transmit(std::string_view setting, Family family) {
    if (setting == "keep") return {};
    if (setting == "nothing") return 0;
    if (setting == "data") return transmit_data;
    if (setting == "serial") return transmit_serial;
    if (setting == "both" || family == Family::iso15693) return transmit_serial | transmit_data;
    return transmit_data;
}

void decide_registers(UnitState& unit, const Settings& settings) {
    unit.wanted = unit.now;
    if (!settings.text("first_block").empty())
        unit.wanted.first_block = static_cast<std::uint32_t>(settings.number("first_block"));
    if (!settings.text("blocks").empty())
        unit.wanted.block_count = static_cast<std::uint32_t>(settings.number("blocks")) - 1;
    if (auto transmit = wanted_transmit(settings.text("transmit"), unit.kind()))
        unit.wanted.transmit = transmit;
}

std::optional<Code> reading_mode(std::string_view setting, Family family) {
    Code code = Code::read_forever;
    if (setting == "sr") code = Code::read_once;
    if (setting == "rc") code = Code::read_checked;
    if (setting == "as") code = Code::read_serial;
    if (!query(code).known_to(family)) return {};
    return code;
}

namespace {

class Setup final : public Task {
public:
    explicit Setup(UnitState& unit) : unit_(unit) {}

    std::optional<Request> next() override {
        auto code = differs();
        if (!code) return {};
        code_ = *code;
        return unit_.set(code_, *unit_.wanted.at(code_));
    }
    void answered(const Reply& reply) override {
        auto& wanted = unit_.wanted.at(code_);
        auto& now = unit_.now.at(code_);
        auto got = number_in(reply);
        if (got) now = got;
        if (got == wanted) return;
        auto words = got ? fmt::format("it took {} instead", *got) : reply.words();
        troubles.push_back({fault_setting, fmt::format("setting {} to {}: {}", setter(code_).parts[0].name,
                                                       *wanted, words)});
        wanted = now;
    }

private:
    std::optional<Code> differs() {
        bool first = unit_.differs(Code::first_block), count = unit_.differs(Code::block_count);
        // Both together must stay within the tag at every moment (section 5.1).
        bool too_far = unit_.wanted.first_block.value_or(0) + unit_.now.block_count.value_or(0) > 15;
        if (count && (!first || too_far)) return Code::block_count;
        if (first) return Code::first_block;
        if (unit_.differs(Code::transmit)) return Code::transmit;
        return {};
    }

    UnitState& unit_;
    Code code_ = Code::first_block;
};

// One command whose echo is all that matters.
class Start final : public Task {
public:
    Start(UnitState& unit, Code mode) : unit_(unit), mode_(mode) {}
    std::optional<Request> next() override {
        if (std::exchange(sent_, true)) return {};
        return unit_.ask(mode_);
    }
    void answered(const Reply& reply) override {
        if (reply.ok())
            unit_.reading = mode_;
        else
            troubles.push_back(
                {fault_reading, fmt::format("starting to read ({}): {}", query(mode_).name, reply.words())});
    }

private:
    UnitState& unit_;
    Code mode_;
    bool sent_ = false;
};

class Stop final : public Task {
public:
    explicit Stop(UnitState& unit) : unit_(unit) {}
    std::optional<Request> next() override {
        if (std::exchange(sent_, true)) return {};
        return unit_.ask(Code::stop);
    }
    void answered(const Reply& reply) override {
        if (reply.ok())
            unit_.reading.reset();
        else
            troubles.push_back({fault_reading, fmt::format("stopping to read: {}", reply.words())});
    }

private:
    UnitState& unit_;
    bool sent_ = false;
};

class Reread final : public Task {
public:
    explicit Reread(UnitState& unit) : unit_(unit) {}
    std::optional<Request> next() override {
        switch (step_) {
            case 0:
                return unit_.ask(Code::field_off);
            case 1:
                return Request{.until = Request::Until::time, .patience = field_off_time};
            case 2: {
                auto request = unit_.ask(Code::field_on);
                request.tries = 3;  // without it nothing is read any more
                return request;
            }
            default:
                return {};
        }
    }
    void answered(const Reply& reply) override {
        if (step_ != 1 && !reply.ok())
            troubles.push_back({fault_reading, fmt::format("switching the field {}: {}",
                                                           step_ == 0 ? "off" : "on", reply.words())});
        ++step_;  // on again in any case
    }

private:
    UnitState& unit_;
    unsigned step_ = 0;
};

}  // namespace

std::unique_ptr<Task> make_setup_task(UnitState& unit) {
    return std::make_unique<Setup>(unit);
}
std::unique_ptr<Task> make_start_task(UnitState& unit, Code mode) {
    return std::make_unique<Start>(unit, mode);
}
std::unique_ptr<Task> make_stop_task(UnitState& unit) {
    return std::make_unique<Stop>(unit);
}
std::unique_ptr<Task> make_reread_task(UnitState& unit) {
    return std::make_unique<Reread>(unit);
}

}  // namespace gantry::dagprog
