#include "protocols/caen/driver_setup.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::caen {

// Of a reader whose model is not known: no reader named anywhere has more (section 10).
static constexpr std::size_t most_sources = 4, most_read_points = 4;

// Parameters of SetSourceConfig (section 4.2).
static constexpr std::int64_t config_q = 3, config_session = 4, config_target = 5, config_selected = 6,
                              config_desb = 7, config_dwell = 8, config_tid_length = 13;
static constexpr std::uint8_t first_revision_with_q_config = 12;

static std::vector<std::string_view> split(std::string_view text, char at) {
    std::vector<std::string_view> pieces;
    for (std::size_t from = 0; from <= text.size();) {
        auto end = std::min(text.find(at, from), text.size());
        pieces.push_back(trimmed(text.substr(from, end - from)));
        from = end + 1;
    }
    return pieces;
}

Result<std::vector<Source>> parse_sources(std::string_view text) {
    std::vector<Source> sources;
    if (trimmed(text).empty()) return sources;
    // Names are ASCII with a NUL, at most 30 and 5 bytes long (section 4).
    auto fits = [](std::string_view name, std::size_t size) {
        return !name.empty() && name.size() < size && is_printable_ascii(name);
    };
    for (auto piece : split(text, ',')) {
        auto equals = piece.find('=');
        Source source;
        source.name = trimmed(piece.substr(0, equals));
        source.composed = equals != std::string_view::npos;
        if (source.composed)
            for (auto point : split(piece.substr(equals + 1), '+')) {
                if (!fits(point, row_of(Attribute::read_point_name).size))
                    return fail(fmt::format("sources: \"{}\" is no read point", printable(point)),
                                "write it like \"Source_0=Ant0+Ant1\"");
                source.read_points.emplace_back(point);
            }
        if (!fits(source.name, row_of(Attribute::source_name).size) ||
            std::ranges::find(sources, source.name, &Source::name) != sources.end())
            return fail(fmt::format("sources: \"{}\" is no source, or is named twice", printable(piece)),
                        "write them like \"Source_0,Source_1\"");
        sources.push_back(std::move(source));
    }
    return sources;
}

Setup::Setup(const DriverOptions& options, ReaderState& reader, Described& described, Reports& reports)
    : options_(options), reader_(reader), described_(described), reports_(reports) {
    if (!options_.model.empty()) reader_.model = find_model(options_.model);
    described_.model = options_.model;
    if (reader_.has(Command::get_reader_info)) add(What::info, Request(Command::get_reader_info));
    add(What::firmware, Request(Command::get_firmware_release));
}

void Setup::add(What what, Request request, std::string text) {
    steps_.push_back({.what = what, .request = std::move(request), .text = std::move(text)});
}

std::optional<Request> Setup::next(Now now) {
    if (steps_.empty() && !planned_) plan(now);
    if (steps_.empty() && !settings_planned_) plan_settings(now);
    if (steps_.empty()) return {};
    return steps_.front().request;
}

// "<model> <serial>" (section 4, 0x76).
void Setup::identified(const Reply& reply) {
    auto info = reply.parsed.text(Attribute::reader_info);
    if (!reply.ok() || !info) return;
    auto name = info->substr(0, info->find(' '));
    auto serial = trimmed(info->substr(name.size()));
    if (options_.model.empty()) {
        reader_.model = find_model(name);
        described_.model = printable(name);
    } else if (reader_.model == nullptr || find_model(name) != reader_.model) {
        described_.detail = fmt::format("says that it is a {}; ", printable(name));
    }
    if (!serial.empty()) described_.detail += fmt::format("serial {}; ", printable(serial));
}

void Setup::answered(const Reply& reply, Now now) {
    auto step = std::move(steps_.front());
    steps_.pop_front();
    switch (step.what) {
        case What::info:
            identified(reply);
            break;
        case What::firmware:
            if (auto release = reply.parsed.text(Attribute::fw_release); reply.ok() && release)
                described_.firmware = printable(*release);
            break;
        case What::protocol:
            break;  // ReaderState::learn took it
        case What::probe:
            if (!reply.ok()) break;
            reader_.sources.push_back({.name = source_name(probed_)});
            if (++probed_ < most_sources) {
                Request request(Command::get_source_config);
                request.text(Attribute::source_name, source_name(probed_));
                request.number(Attribute::config_parameter, 0);
                add(What::probe, std::move(request));
            }
            break;
        case What::check_point: {
            auto there = reply.parsed.number(Attribute::boolean);
            if (!reply.ok() || !there) {
                refused(step, reply, now);
            } else if ((*there != 0) != step.wanted) {
                // The manual asks with the read point first and changes with the source first (section 6).
                AvpReader pairs(step.request.pairs);
                auto point = pairs.next(), source = pairs.next();
                Request change(step.wanted ? Command::add_read_point_to_source
                                           : Command::remove_read_point_from_source);
                change.text(Attribute::source_name, source->text());
                change.text(Attribute::read_point_name, point->text());
                steps_.push_front(
                    {.what = What::setting, .request = std::move(change), .text = std::move(step.text)});
            }
            break;
        }
        case What::setting:
            if (reply.ok()) break;
            refused(step, reply, now);
            // Jobs must know from which protocol they switch.
            if (step.request.is(Command::set_protocol) && reader_.has(Command::get_protocol))
                add(What::protocol, Request(Command::get_protocol));
            break;
    }
}

void Setup::refused(const Step& step, const Reply& reply, Now now) {
    auto code = reply.parsed.result && !reply.silent ? std::int64_t{*reply.parsed.result} : fault_setting;
    say(code, fmt::format("{} is not applied: {} answered {}", step.text, step.request.name(), reply.words()),
        now);
}

// Once, though the sources may all say the same.
void Setup::say(std::int64_t code, std::string text, Now now) {
    if (said_.insert(text).second) reports_.notice(FaultNotice{code, std::move(text), {}}, now);
}

void Setup::plan(Now now) {
    planned_ = true;
    plan_sources(now);
    bool set = !options_.settings.text("protocol").empty() && reader_.has(Command::set_protocol);
    if (!set && reader_.has(Command::get_protocol)) add(What::protocol, Request(Command::get_protocol));
}

void Setup::plan_sources(Now now) {
    auto given = parse_sources(options_.settings.text("sources"));
    if (!given)
        say(fault_setting, given.error().text(), now);
    else
        reader_.sources = std::move(*given);
    if (!reader_.sources.empty()) return;
    if (reader_.model != nullptr) {
        for (std::size_t i = 0; i < std::max<std::size_t>(reader_.model->sources, 1); ++i)
            reader_.sources.push_back({.name = source_name(i)});
        return;
    }
    // An unknown reader has its first source, and those after it for which it has a configuration.
    reader_.sources.push_back({.name = source_name(0)});
    probed_ = 1;
    Request request(Command::get_source_config);
    request.text(Attribute::source_name, source_name(probed_));
    request.number(Attribute::config_parameter, 0);
    add(What::probe, std::move(request));
}

void Setup::add_setting(std::string_view name, Request request) {
    add(What::setting, std::move(request), std::string(name));
}

void Setup::add_number(std::string_view name, Command command, Attribute attribute) {
    if (options_.settings.text(name).empty()) return;
    Request request(command);
    request.number(attribute, static_cast<std::uint64_t>(options_.settings.number(name)));
    add_setting(name, std::move(request));
}

void Setup::add_choice(std::string_view name, Command command, Attribute attribute,
                       const wire::Enumeration& names) {
    auto* row = names.find(options_.settings.text(name));
    if (row == nullptr) return;  // empty: not given
    Request request(command);
    request.number(attribute, static_cast<std::uint64_t>(row->value));
    add_setting(name, std::move(request));
}

void Setup::add_config(std::string_view name, std::int64_t parameter) {
    if (options_.settings.text(name).empty()) return;
    add_config(name, parameter, static_cast<std::uint64_t>(options_.settings.number(name)));
}

void Setup::add_config(std::string_view name, std::int64_t parameter, std::uint64_t value) {
    for (auto& source : reader_.sources) {
        Request request(Command::set_source_config);
        request.text(Attribute::source_name, source.name);
        request.number(Attribute::config_parameter, static_cast<std::uint64_t>(parameter));
        request.number(Attribute::config_value, value);
        add_setting(name, std::move(request));
    }
}

void Setup::plan_settings(Now now) {
    settings_planned_ = true;
    auto& settings = options_.settings;
    add_choice("regulation", Command::set_rf_regulation, Attribute::rf_regulation, rf_regulations);
    // It has a fallback: not asked of a model that cannot be set.
    if (reader_.has(Command::set_protocol))
        add_choice("protocol", Command::set_protocol, Attribute::protocol, protocols);
    add_number("power_mw", Command::set_power, Attribute::power_set);
    if (auto lbt = settings.text("lbt"); !lbt.empty())
        add_setting("lbt", Request(Command::set_lbt_mode).number(Attribute::boolean, lbt == "on" ? 1 : 0));
    add_number("channel", Command::set_rf_channel, Attribute::rf_channel);
    if (settings.boolean("set_clock")) {
        auto time = to_rfc3339(now.wall);  // 2026-11-21T23:04:00.123456Z
        add_setting("set_clock",
                    Request(Command::set_date_time)
                        .text(Attribute::date_time, time.substr(0, 10) + " " + time.substr(11, 8)));
    }
    for (auto& source : reader_.sources) {
        if (!source.composed) continue;
        auto points = source.read_points;
        auto count = reader_.model != nullptr ? std::size_t{reader_.model->read_points} : most_read_points;
        for (std::size_t i = 0; i < count; ++i)
            if (std::ranges::find(points, read_point_name(i)) == points.end())
                points.push_back(read_point_name(i));
        for (auto& point : points) {
            Request request(Command::check_read_point_in_source);
            request.text(Attribute::read_point_name, point).text(Attribute::source_name, source.name);
            steps_.push_back(
                {.what = What::check_point,
                 .request = std::move(request),
                 .text = fmt::format("sources ({} of {})", point, source.name),
                 .wanted = std::ranges::find(source.read_points, point) != source.read_points.end()});
        }
    }
    // Revision 4 has one Q for the whole reader, later ones a Q for each source.
    if (reader_.model != nullptr && reader_.model->revision < first_revision_with_q_config)
        add_number("q", Command::g2_set_q, Attribute::q_parameter);
    else
        add_config("q", config_q);
    add_choice("bit_rate", Command::set_bit_rate, Attribute::bit_rate, bit_rates);
    add_config("dwell", config_dwell);
    if (auto desb = settings.text("desb"); !desb.empty()) {
        if (reader_.model != nullptr && reader_.has(Command::set_desb))
            add_setting("desb",
                        Request(Command::set_desb).number(Attribute::desb_enable, desb == "on" ? 1 : 0));
        else
            add_config("desb", config_desb, desb == "on" ? 1 : 0);
    }
    add_config("session", config_session);
    add_config("target", config_target);
    add_config("selected", config_selected);
    add_config("tid_length", config_tid_length);

    // What the model is known to lack is not asked for, but said.
    std::erase_if(steps_, [&](const Step& step) {
        auto* row = find_command(step.request.command);
        if (reader_.model == nullptr || row == nullptr || caen::has(*reader_.model, *row)) return false;
        say(fault_setting,
            fmt::format("{} is not applied: the model {} has no {}", step.text, reader_.model->name,
                        row->name),
            now);
        return true;
    });
}

}  // namespace gantry::caen
