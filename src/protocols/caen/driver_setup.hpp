#pragma once
#include <deque>
#include <set>

#include "protocols/caen/driver_dialog.hpp"
#include "reader/plugin.hpp"

namespace gantry::caen {

// "Source_0=Ant0+Ant1,Source_1"; blanks are allowed. An error names the piece that is none.
Result<std::vector<Source>> parse_sources(std::string_view text);

// The first minute of every connection: who is it, and the settings that are given, one command each. What
// the reader refuses becomes a notice, and the rest goes on.
class Setup final : public Task {
public:
    Setup(const DriverOptions& options, ReaderState& reader, Described& described, Reports& reports);
    std::optional<Request> next(Now now) override;
    void answered(const Reply& reply, Now now) override;

private:
    enum class What : std::uint8_t { info, firmware, protocol, probe, check_point, setting };
    struct Step {
        What what;
        Request request;
        std::string text = {};  // what the user called it
        bool wanted = false;    // check_point: should the source have it?
    };

    void add(What what, Request request, std::string text = {});
    void add_setting(std::string_view name, Request request);
    void add_number(std::string_view name, Command command, Attribute attribute);
    void add_choice(std::string_view name, Command command, Attribute attribute,
                    const wire::Enumeration& names);
    void add_config(std::string_view name, std::int64_t parameter);
    void add_config(std::string_view name, std::int64_t parameter, std::uint64_t value);
    void identified(const Reply& reply);
    void plan(Now now);
    void plan_sources(Now now);
    void plan_settings(Now now);
    void refused(const Step& step, const Reply& reply, Now now);
    void say(std::int64_t code, std::string text, Now now);

    const DriverOptions& options_;
    ReaderState& reader_;
    Described& described_;
    Reports& reports_;
    std::deque<Step> steps_;
    std::set<std::string> said_;
    bool planned_ = false, settings_planned_ = false;
    std::size_t probed_ = 0;
};

}  // namespace gantry::caen
