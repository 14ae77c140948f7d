#pragma once
#include "driver_support.hpp"

namespace gantry::caen::driver_test {

using Status = JobResult::Status;

inline const std::string tag_a = "3074257BF7194E4000001A85", tag_b = "3074257BF7194E4000001A86";

inline Ours::Answer gives(Attribute attribute, std::uint32_t value) {
    return [=](auto&, Bytes& pairs) {
        append_number(pairs, attribute, value);
        return ResultCode::success;
    };
}
inline TagAccess access_to(std::string_view id, event::Technology technology = event::Technology::epc_gen2) {
    TagAccess access;
    access.tag = epc(id);
    access.technology = technology;
    return access;
}
inline Execute command(std::string name, wire::Fields fields = {}) {
    return {{.name = std::move(name), .header = {}, .fields = std::move(fields)}};
}
inline std::string value_text(const JobResult& result, std::string_view name) {
    auto* value = wire::find(result.values, name);
    if (value == nullptr) return "-";
    if (auto* text = value->get<std::string>()) return *text;
    if (auto* data = value->get<Bytes>()) return to_hex(*data);
    return std::to_string(*value->get<std::int64_t>());
}

struct Idle : Ours {  // reads nothing by itself
    explicit Idle(std::string model = "R1260I", const Given& settings = {{"mode", "inventory"}})
        : Ours(settings, std::move(model)) {
        driver.admitted({.mark = {}, .reading = false}, now);
        starts();
        heard.clear();
    }
};

}  // namespace gantry::caen::driver_test
