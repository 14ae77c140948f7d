#include "cli/reader_json.hpp"

namespace gantry::cli {

boost::json::object to_json(const DirectReader::Status& status, const gateway::Address& address) {
    boost::json::object out;
    out["name"] = status.name.empty() ? address.text : status.name;
    out["make"] = address.plugin->name;
    out["address"] = address.text;
    out["connected"] = status.connected && status.answered;
    out["state"] = !status.connected  ? status.ended
                   : !status.answered ? "the line is open, nobody has answered yet"
                   : status.stalled   ? "connected, stalled"
                                      : "connected";
    out["peer"] = status.peer;
    if (status.described) {
        auto add = [&](std::string_view key, const std::string& value) {
            if (!value.empty()) out[key] = value;
        };
        add("model", status.described->model);
        add("firmware", status.described->firmware);
        add("detail", status.described->detail);
    }
    out["reads"] = status.reads;
    boost::json::object counters;
    for (std::size_t i = 0; i < count_size; ++i)
        counters[to_text(static_cast<Count>(i))] = status.counters[i];
    out["counters"] = std::move(counters);
    return out;
}

}  // namespace gantry::cli
