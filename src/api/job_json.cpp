#include "api/job_json.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>

#include <fmt/format.h>
#include <boost/json.hpp>

#include "api/message_json.hpp"
#include "base/text.hpp"
#include "reader/parameter.hpp"

namespace gantry::api {

namespace json = boost::json;

namespace {
// One member after the other, each checked; the first that is wrong is what the user hears of.
class Members {
public:
    explicit Members(const json::object& object) : object_(object) {}

    bool has(std::string_view key) const { return object_.contains(key); }
    const json::value* find(std::string_view key) const { return object_.if_contains(key); }

    std::optional<std::string> text(std::string_view key) {
        const auto* value = find(key);
        if (value == nullptr) return {};
        if (const auto* text = value->if_string()) return std::string(*text);
        wrong(fmt::format("\"{}\" must be text", key));
        return {};
    }
    template <class T>
    void number(std::string_view key, T& into, T least, T most) {
        const auto* value = find(key);
        if (value == nullptr) return;
        json::error_code error;
        auto number = value->is_number() ? value->to_number<std::int64_t>(error) : -1;
        if (!value->is_number() || error || number < std::int64_t{least} || number > std::int64_t{most})
            return wrong(fmt::format("\"{}\" must be a whole number from {} to {}", key, least, most));
        into = static_cast<T>(number);
    }
    void boolean(std::string_view key, bool& into) {
        const auto* value = find(key);
        if (value == nullptr) return;
        if (!value->is_bool()) return wrong(fmt::format("\"{}\" must be true or false", key));
        into = value->get_bool();
    }
    std::optional<Bytes> hex(std::string_view key) {
        auto given = text(key);
        if (!given) return {};
        auto bytes = from_hex(*given);
        if (!bytes) wrong(fmt::format("\"{}\" is not hex", key), "two digits a byte: \"3074257B\"");
        return bytes;
    }
    // "C0FFEE01", up to eight digits.
    void password(std::string_view key, std::uint32_t& into) {
        auto given = text(key);
        if (!given) return;
        std::uint32_t number = 0;
        const auto* last = given->data() + given->size();
        auto [end, error] = std::from_chars(given->data(), last, number, 16);
        if (error != std::errc{} || end != last)
            return wrong(fmt::format("\"{}\" must be up to eight hex digits", key));
        into = number;
    }
    std::optional<event::TagId> tag(std::string_view key) {
        auto bytes = hex(key);
        if (!bytes) return {};
        if (bytes->empty() || bytes->size() > event::TagId::max_size) {
            wrong(fmt::format("\"{}\" must have 1 to {} bytes", key, event::TagId::max_size));
            return {};
        }
        return event::TagId(*bytes);
    }

    void wrong(std::string what, std::string hint = {}) {
        if (!error_) error_ = Error{std::move(what), std::move(hint)};
    }
    void need(std::string_view key, std::string_view sample) {
        if (!has(key)) wrong(fmt::format("the job needs \"{}\"", key), fmt::format("\"{}\":{}", key, sample));
    }
    template <class T>
    Result<Job> finish(T job) {
        if (error_) return tl::unexpected(*error_);
        return Job(std::move(job));
    }

private:
    const json::object& object_;
    std::optional<Error> error_;
};

Result<Job> gpio_set(Members& in, const Plugin& /*make*/) {
    SetOutputs job;
    const auto* outputs = in.find("outputs");
    if (outputs == nullptr || !outputs->is_array() || outputs->get_array().empty())
        in.wrong("gpio.set needs \"outputs\"", "a list of {\"output\":1,\"state\":true,\"for_ms\":7000}");
    else
        for (auto& each : outputs->get_array()) {
            const auto* object = each.if_object();
            if (object == nullptr || !object->contains("output") || !object->contains("state")) {
                in.wrong("an output must be {\"output\":1 to 255,\"state\":true or false}");
                break;
            }
            Members members(*object);
            OutputChange change;
            members.number<std::uint16_t>("output", change.output, 1, 255);
            members.boolean("state", change.state);
            members.number<std::uint32_t>("for_ms", change.for_ms, 0, 86'400'000);
            if (auto fine = members.finish(GetInputs{}); !fine)
                in.wrong("an output must be {\"output\":1 to 255,\"state\":true or false}",
                         fine.error().what);
            job.changes.push_back(change);
        }
    return in.finish(std::move(job));
}

TagAccess access(Members& in, const Plugin& make) {
    TagAccess out;
    in.need("tag", "\"3074257BF7194E4000001A85\"");
    out.tag = in.tag("tag").value_or(event::TagId{});
    if (auto name = in.text("technology")) {
        auto technology = event::parse_technology(*name);
        std::vector<std::string_view> names;
        for (auto& each : event::all_technologies())
            names.push_back(each.name);
        if (technology)
            out.technology = *technology;
        else
            in.wrong(fmt::format("there is no technology \"{}\"", printable(*name)),
                     near_or_all(*name, names));
    }
    if (auto name = in.text("antenna")) {
        constexpr std::uint16_t most = 256;  // no make counts further in its reports
        for (std::uint16_t number = 0; number < most && !out.antenna; ++number)
            if (make.antenna_name(number) == *name) out.antenna = number;
        if (!out.antenna)
            in.wrong(fmt::format("{} readers have no antenna \"{}\"", make.name, printable(*name)),
                     fmt::format("theirs are called {}, {}, …", make.antenna_name(1), make.antenna_name(2)));
    }
    in.password("access_password", out.password);
    in.number<std::uint8_t>("retries", out.retries, 0, 100);
    return out;
}

void bank(Members& in, Bank& into) {
    auto name = in.text("bank");
    if (!name) return;
    auto found = parse_bank(*name);
    if (!found)
        return in.wrong(fmt::format("there is no bank \"{}\"", printable(*name)),
                        "reserved, epc, tid or user");
    into = *found;
}

constexpr std::uint32_t max_address = 0xFF'FFFF;  // far beyond every tag there is

Result<Job> tag_read(Members& in, const Plugin& make) {
    ReadTag job;
    job.access = access(in, make);
    bank(in, job.bank);
    in.number<std::uint32_t>("offset", job.offset, 0, max_address);
    in.number<std::uint32_t>("length", job.length, 1, 0xFFFF);
    return in.finish(job);
}

Result<Job> tag_write(Members& in, const Plugin& make) {
    WriteTag job;
    job.access = access(in, make);
    bank(in, job.bank);
    in.number<std::uint32_t>("offset", job.offset, 0, max_address);
    in.need("data", "\"00112233\"");
    job.data = in.hex("data").value_or(Bytes{});
    if (job.data.empty() || job.data.size() > 0xFFFF) in.wrong("\"data\" must have 1 to 65535 bytes");
    if (job.access.technology == event::Technology::epc_gen2 && job.data.size() % 2 != 0)
        in.wrong("\"data\" must be whole words for this tag: an even number of bytes");
    in.boolean("verify", job.verify);
    return in.finish(std::move(job));
}

Result<Job> tag_program(Members& in, const Plugin& make) {
    ProgramTag job;
    job.access = access(in, make);
    in.need("new_tag", "\"3074257BF7194E4000001A86\"");
    job.new_id = in.tag("new_tag").value_or(event::TagId{});
    in.number<std::uint16_t>("numbering_system", job.numbering_system, 0, 0x1FF);
    in.boolean("verify", job.verify);
    return in.finish(job);
}

// The lock payload of Gen2: for each memory two bits, in this order from the highest; the second of a pair
// makes it permanent.
constexpr std::array<std::string_view, 5> lock_fields = {"kill", "access", "epc", "tid", "user"};
constexpr std::array<std::string_view, 4> lock_states = {"open", "permanently_open", "locked",
                                                         "permanently_locked"};
constexpr std::uint16_t permanent_bits = 0b01'0101'0101;

void lock_fields_of(Members& in, const json::value& value, LockTag& job) {
    const auto* object = value.if_object();
    if (object == nullptr || object->empty())
        return in.wrong("\"fields\" must be an object", "{\"user\":\"locked\"}");
    for (auto& member : *object) {
        std::string_view name(member.key().data(), member.key().size());
        const auto* field = std::ranges::find(lock_fields, name);
        if (field == lock_fields.end())
            return in.wrong(fmt::format("there is no lock for \"{}\"", printable(name)),
                            near_or_all(name, lock_fields));
        const auto* text = member.value().if_string();
        std::string_view wanted = text == nullptr ? "" : std::string_view(text->data(), text->size());
        const auto* state = std::ranges::find(lock_states, wanted);
        if (state == lock_states.end())
            return in.wrong(fmt::format("{}: \"{}\" is no state of a lock", name, printable(wanted)),
                            near_or_all(wanted, lock_states));
        auto shift = 2 * (lock_fields.end() - field - 1);
        job.mask = static_cast<std::uint16_t>(job.mask | 0b11 << shift);
        job.action = static_cast<std::uint16_t>(job.action | (state - lock_states.begin()) << shift);
    }
}

void confirm(Members& in, std::string_view what) {
    bool confirmed = false;
    in.boolean("confirm", confirmed);
    if (!confirmed)
        in.wrong(fmt::format("{} cannot be undone, and nobody has confirmed it", what),
                 "add \"confirm\":true");
}

Result<Job> tag_lock(Members& in, const Plugin& make) {
    LockTag job;
    job.access = access(in, make);
    int ways = (in.has("fields") ? 1 : 0) + (in.has("address") ? 1 : 0) +
               (in.has("mask") || in.has("action") ? 1 : 0);
    if (ways != 1)
        in.wrong("tag.lock needs one of \"fields\", \"mask\" with \"action\", and \"address\"",
                 "\"fields\":{\"user\":\"locked\"}");
    if (const auto* fields = in.find("fields")) lock_fields_of(in, *fields, job);
    if (in.has("mask") || in.has("action")) {
        in.need("mask", "3");
        in.need("action", "2");
        in.number<std::uint16_t>("mask", job.mask, 1, 0x3FF);
        in.number<std::uint16_t>("action", job.action, 0, 0x3FF);
    }
    if (in.has("address")) {
        std::uint32_t address = 0;
        in.number<std::uint32_t>("address", address, 0, max_address);
        job.address = address;
        confirm(in, "locking a part of this memory");
    }
    if ((job.mask & job.action & permanent_bits) != 0) confirm(in, "a permanent lock");
    return in.finish(job);
}

Result<Job> tag_kill(Members& in, const Plugin& make) {
    KillTag job;
    job.access = access(in, make);
    in.need("kill_password", "\"00000001\"");
    in.password("kill_password", job.kill_password);
    confirm(in, "killing a tag");
    return in.finish(job);
}

void check_parameter(Members& in, const Plugin& make, const std::string& name) {
    if (auto fine = check_parameter_name(make, name); !fine) in.wrong(fine.error().what, fine.error().hint);
}

Result<Job> config_get(Members& in, const Plugin& make) {
    GetParameter job;
    if (auto name = in.text("parameter")) {
        job.name = std::move(*name);
        if (!job.name.empty()) check_parameter(in, make, job.name);
        const auto* row = find_parameter(make, job.name);
        if (row != nullptr && row->secret) in.wrong(fmt::format("{} is never read, only set", row->name));
    }
    in.boolean("permanent", job.permanent);
    return in.finish(std::move(job));
}

Result<Job> config_set(Members& in, const Plugin& make) {
    SetParameter job;
    in.need("parameter", "\"NAME\"");
    in.need("value", "1");
    job.name = in.text("parameter").value_or("");
    if (const auto* value = in.find("value")) {
        if (const auto* text = value->if_string())
            job.value.assign(text->begin(), text->end());
        else if (value->is_bool() || value->is_int64() || value->is_double())
            job.value = json::serialize(*value);
        else
            in.wrong("\"value\" must be text, a number, true or false");
    }
    in.boolean("permanent", job.permanent);
    check_parameter(in, make, job.name);
    if (const auto* row = find_parameter(make, job.name))
        if (auto fine = typed_parameter(make, *row, job.value); !fine)
            in.wrong(fine.error().what, fine.error().hint);
    return in.finish(std::move(job));
}

Result<Job> exec(Members& in, const Plugin& make) {
    Execute job;
    in.need("command", "\"NAME\"");
    job.command.name = in.text("command").value_or("");
    auto names = make.codec().names(wire::Direction::to_reader);
    if (in.has("command") && std::ranges::find(names, job.command.name) == names.end())
        in.wrong(fmt::format("{} has no command \"{}\"", make.name, printable(job.command.name)),
                 near_or_all(job.command.name, names));
    if (make.is_final(job.command.name)) confirm(in, job.command.name);
    if (const auto* given = in.find("fields")) {
        auto fields = fields_from_json(*given);
        if (fields)
            job.command.fields = std::move(*fields);
        else
            in.wrong(fields.error().what, fields.error().hint);
    }
    return in.finish(std::move(job));
}

template <class T>
Result<Job> plain(Members& in, const Plugin& /*make*/) {
    return in.finish(T{});
}

// `members`: what a request of this kind may hold beside what every request may.
struct Op {
    std::string_view name;
    Result<Job> (*parse)(Members& in, const Plugin& make);
    bool of_tag = false;
    std::array<std::string_view, 6> members = {};
};
constexpr std::array ops = {
    Op{"gpio.get", plain<GetInputs>},
    Op{"gpio.set", gpio_set, false, {"outputs"}},
    Op{"restart", plain<RestartReader>},
    Op{"reader.start", plain<StartReading>},
    Op{"reader.stop", plain<StopReading>},
    Op{"tag.read", tag_read, true, {"bank", "offset", "length"}},
    Op{"tag.write", tag_write, true, {"bank", "offset", "data", "verify"}},
    Op{"tag.program", tag_program, true, {"new_tag", "numbering_system", "verify"}},
    Op{"tag.lock", tag_lock, true, {"fields", "mask", "action", "address", "confirm"}},
    Op{"tag.kill", tag_kill, true, {"kill_password", "confirm"}},
    Op{"config.get", config_get, false, {"parameter", "permanent"}},
    Op{"config.set", config_set, false, {"parameter", "value", "permanent"}},
    Op{"exec", exec, false, {"command", "fields", "confirm"}},
};
constexpr std::array<std::string_view, 4> of_all = {"reader", "op", "timeout_ms", "wait"};
constexpr std::array<std::string_view, 5> of_tags = {"tag", "technology", "antenna", "access_password",
                                                     "retries"};

// A slip in an optional member must not turn a job into another one.
void refuse_unknown(Members& in, const json::object& request, const Op& op) {
    std::vector<std::string_view> known(of_all.begin(), of_all.end());
    if (op.of_tag) known.insert(known.end(), of_tags.begin(), of_tags.end());
    for (auto member : op.members)
        if (!member.empty()) known.push_back(member);
    for (auto& member : request) {
        std::string_view name(member.key().data(), member.key().size());
        if (std::ranges::find(known, name) == known.end())
            in.wrong(fmt::format("{} has no \"{}\"", op.name, printable(name)), near_or_all(name, known));
    }
}
}  // namespace

Result<Job> job_from_json(const json::object& request, const Plugin& make) {
    std::vector<std::string_view> names;
    for (auto& op : ops)
        names.push_back(op.name);
    Members in(request);
    auto name = in.text("op");
    if (!name) return fail("a job needs \"op\"", near_or_all("", names));
    const auto* op = std::ranges::find(ops, *name, &Op::name);
    if (op == ops.end())
        return fail(fmt::format("there is no job \"{}\"", printable(*name)), near_or_all(*name, names));
    refuse_unknown(in, request, *op);
    return op->parse(in, make);
}

json::object job_to_json(const gateway::JobStatus& job, Values values) {
    json::object out;
    out["id"] = job.id;
    out["reader"] = job.reader;
    out["op"] = job.op;
    if (!job.detail.empty()) out["detail"] = job.detail;
    out["status"] = gateway::to_text(job.state);
    if (!job.text.empty()) out["text"] = is_utf8(job.text) ? job.text : printable(job.text);
    out["created"] = to_rfc3339(job.created);
    out["deadline"] = to_rfc3339(job.deadline);
    if (job.ended) out["ended"] = to_rfc3339(*job.ended);
    if (values == Values::shown && !job.values.empty()) {
        if (job.op == "exec")
            out["values"] = pairs_to_json(job.values);
        else
            out["values"] = to_json(job.values);
    }
    return out;
}

}  // namespace gantry::api
