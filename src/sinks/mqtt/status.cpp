#include "sinks/mqtt/status.hpp"

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::mqtt {

static constexpr auto text_period = 30s;

static std::string json(std::string_view text) {
    std::string out;
    append_json_string(out, text);
    return out;
}

std::string status_payload(const sink::ReaderState& reader) {
    return fmt::format(R"({{"availability":"{}","reader":{},"make":{},"text":{}}})",
                       reader.connected ? "online" : "offline", json(reader.name), json(reader.make),
                       json(reader.text));
}

// Discovery takes letters, digits, "-" and "_" only. Different names stay different.
static std::string object_id(std::string_view name) {
    std::string out;
    for (char c : name) {
        bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-';
        if (plain)
            out += c;
        else
            out += fmt::format("_{:02X}", static_cast<unsigned char>(c));
    }
    return out;
}

std::vector<Retained> discovery(const Topics& topics, std::string_view prefix, std::string_view gateway_id,
                                const sink::ReaderState& reader) {
    auto id = fmt::format("gantry_{}__{}", object_id(gateway_id), object_id(reader.name));
    auto device =
        fmt::format(R"("device":{{"identifiers":["{}"],"name":{},"manufacturer":{},"model":"RFID reader"}},)"
                    R"("origin":{{"name":"Gantry","sw_version":"{}"}})",
                    id, json(reader.name), json(reader.make), GANTRY_VERSION);
    auto connectivity = fmt::format(
        R"({{"name":"Connection","unique_id":"{0}_connection","device_class":"connectivity",)"
        R"("entity_category":"diagnostic","state_topic":{1},"value_template":"{{{{ value_json.availability }}}}",)"
        R"("payload_on":"online","payload_off":"offline","json_attributes_topic":{1},"availability_topic":{2},{3}}})",
        id, json(topics.status(reader.name)), json(topics.bridge_state()), device);
    // The events of either shape; what gives no text is no scan.
    auto scanner = fmt::format(
        R"({{"topic":{},"value_template":"{{% set e = value_json.data if value_json.specversion is defined else )"
        R"(value_json %}}{{{{ e.tag if e.type == 'tag.new' else '' }}}}",{}}})",
        json(topics.events(reader.name)), device);
    return {{fmt::format("{}/binary_sensor/{}/connection/config", prefix, id), std::move(connectivity)},
            {fmt::format("{}/tag/{}/config", prefix, id), std::move(scanner)}};
}

bool StatusBoard::tell(const sink::ReaderState& reader, bool gone,
                       const std::function<bool(const Retained&)>& put) const {
    if (!put({topics_.status(reader.name), gone ? "" : status_payload(reader)})) return false;
    if (discovery_prefix_.empty()) return true;
    for (auto& each : discovery(topics_, discovery_prefix_, gateway_id_, reader))
        if (!put({each.topic, gone ? "" : each.payload})) return false;
    return true;
}

void StatusBoard::update(const std::vector<sink::ReaderState>& readers, Steady now,
                         const std::function<bool(const Retained&)>& put) {
    present_.clear();
    for (auto& reader : readers)
        present_.insert(topics_.status(reader.name));
    for (auto& reader : readers) {
        auto topic = topics_.status(reader.name);
        auto known = told_.find(topic);
        if (known != told_.end()) {
            auto& [state, at] = known->second;
            bool text_only = state.connected == reader.connected && state.make == reader.make;
            if (text_only && (state.text == reader.text || now - at < text_period)) continue;
            // Discovery says nothing that changes.
            if (!put({topic, status_payload(reader)})) return;
        } else if (!tell(reader, false, put)) {
            return;
        }
        told_[topic] = {reader, now};
    }
    for (auto it = told_.begin(); it != told_.end();) {
        if (present_.contains(it->first)) {
            ++it;
            continue;
        }
        if (!tell(it->second.state, true, put)) return;
        it = told_.erase(it);
    }
}

std::string StatusBoard::correction(std::string_view topic, std::string_view payload) const {
    if (present_.contains(std::string(topic)) ||
        payload.find(R"("availability":"online")") == std::string_view::npos)
        return {};
    return R"({"availability":"offline","text":"not seen since the gateway was started"})";
}

}  // namespace gantry::sinks::mqtt
