#include "protocols/caen/driver_inventory.hpp"

#include <fmt/format.h>

namespace gantry::caen {

std::string_view to_text(Mode mode) {
    switch (mode) {
        case Mode::notify:
            return "notifications";
        case Mode::framed:
            return "the framed stream";
        case Mode::inventory:
            return "InventoryTag rounds";
        case Mode::raw:
            return "RawReadIDs rounds";
    }
    return "";
}

void ReadingPlan::offer(const ReaderState& reader, bool notify_at) {
    modes_.clear();
    said_.clear();
    proven_ = false;
    auto wish = settings_.text("mode");
    bool any = wish == "auto";
    bool channels = reader.model == nullptr ? wish == "notify" : reader.model->notifies;
    if ((any && notify_at) || wish == "notify") {
        if (!notify_at)
            said_.emplace_back("no notify address is configured");
        else if (!channels)
            said_.push_back(fmt::format("{} has no notification channels", reader.model_name()));
        else
            modes_.push_back(Mode::notify);
    }
    bool tagged = reader.has(Command::inventory_tag);
    // The stream is of one source, and until it is aborted no other command may be sent (section 1).
    bool single = reader.sources.size() == 1;
    if (any || wish == "notify" || wish == "framed") {
        if (tagged && single) modes_.push_back(Mode::framed);
        if (wish == "framed" && !single) said_.emplace_back("a framed stream has one source only");
    }
    if (wish == "framed" && !tagged)
        said_.push_back(fmt::format("{} has no InventoryTag", reader.model_name()));
    if (wish != "raw" && tagged) modes_.push_back(Mode::inventory);
    if (reader.has(Command::raw_read_ids)) modes_.push_back(Mode::raw);
    if (wish == "raw" && modes_.empty()) {
        said_.push_back(fmt::format("{} has no RawReadIDs", reader.model_name()));
        if (tagged) modes_.push_back(Mode::inventory);
    }
}

std::optional<Mode> ReadingPlan::mode() const {
    if (modes_.empty()) return {};
    return modes_.front();
}

bool ReadingPlan::refused(std::string why) {
    if (proven_ || modes_.empty()) return false;
    said_.push_back(fmt::format("not with {}: {}", to_text(modes_.front()), why));
    modes_.erase(modes_.begin());
    return true;
}

std::string ReadingPlan::detail() const {
    auto text =
        modes_.empty() ? std::string("does not read") : fmt::format("reads with {}", to_text(modes_.front()));
    if (modes_.size() == 1 && modes_.front() == Mode::raw && !settings_.text("mask").empty())
        text += " without the mask, which RawReadIDs does not know";
    if (mode() == Mode::raw || mode() == Mode::notify) {
        std::vector<std::string_view> missing;
        for (std::string_view each : {"tid", "xpc", "pc"})
            if (settings_.boolean(each)) missing.push_back(each);
        if (!missing.empty())
            text += fmt::format("; only InventoryTag gives {}", fmt::join(missing, " and "));
    }
    for (auto& said : said_)
        text += "; " + said;
    return text;
}

std::uint16_t ReadingPlan::flags() const {
    unsigned flags = 0;
    auto on = [&](std::string_view name, unsigned flag) {
        if (settings_.boolean(name)) flags |= flag;
    };
    on("rssi", flag_rssi);
    on("compact", flag_compact);
    on("tid", flag_tid);
    on("xpc", flag_xpc);
    on("pc", flag_pc);
    if (mode() == Mode::framed) flags |= flag_framed | flag_continuous;
    return static_cast<std::uint16_t>(flags);
}

// Mask and flags only where there are any, as the maker's own client does (section 7).
Request ReadingPlan::request(const Source& source) const {
    if (mode() == Mode::raw) {
        Request raw(Command::raw_read_ids);
        raw.text(Attribute::source_name, source.name);
        return raw;
    }
    Request request(Command::inventory_tag);
    request.text(Attribute::source_name, source.name);
    if (auto mask = from_hex(settings_.text("mask")); mask && !mask->empty()) {
        auto bank = parse_bank(settings_.text("mask_bank"));
        if (bank) request.number(Attribute::memory_bank, static_cast<std::uint64_t>(*bank));
        auto given = static_cast<std::uint64_t>(settings_.number("mask_bits"));
        auto all = std::uint64_t{8} * mask->size();
        request.number(Attribute::length, given == 0 ? all : std::min(given, all));
        request.bytes(Attribute::tag_id, *mask);
        request.number(Attribute::tag_address, static_cast<std::uint64_t>(settings_.number("mask_start")));
    }
    if (auto set = flags(); set != 0) request.number(Attribute::bitmask, set);
    return request;
}

Request ReadingPlan::read_cycle(const Source& source, std::uint32_t cycles) {
    Request request(Command::set_source_config);
    request.text(Attribute::source_name, source.name);
    request.number(Attribute::config_parameter, 0);
    request.number(Attribute::config_value, cycles);
    return request;
}

Request ReadingPlan::get_read_cycle(const Source& source) {
    Request request(Command::get_source_config);
    request.text(Attribute::source_name, source.name);
    request.number(Attribute::config_parameter, 0);
    return request;
}

bool sets_read_cycle(const Request& request) {
    if (!request.is(Command::set_source_config)) return false;
    AvpReader pairs(request.pairs);
    while (auto pair = pairs.next())
        if (pair->is(Attribute::config_parameter)) return pair->number() == 0;
    return false;
}

}  // namespace gantry::caen
