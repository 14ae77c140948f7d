// gantry tag: one tag's memory, id, locks and life.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/input.hpp"
#include "cli/job_text.hpp"
#include "cli/tag_words.hpp"
#include "cli/values.hpp"

namespace gantry::cli {

namespace {
namespace json = boost::json;

// A password never comes out of here but as part of the job; not in an error either.
struct Password {
    std::string name, given, file;

    std::string variable() const {
        std::string out = "GANTRY_" + name;
        for (char& c : out)
            c = c == '-' ? '_' : static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
        return out;
    }
    Result<std::optional<std::string>> read() const;
};

Result<void> is_password(std::string_view text) {
    auto is_digit = [](unsigned char c) { return std::isxdigit(c) != 0; };
    if (text.size() == 8 && std::ranges::all_of(text, is_digit)) return {};
    return fail("that is no password", "a password is 8 hex digits, like 0000ABCD");
}

Result<std::optional<std::string>> Password::read() const {
    std::string text = given, from = "--" + name;
    if (text.empty() && !file.empty()) {
        from = "--" + name + "-file " + printable(file);
        std::ifstream in(file);
        if (!in) return fail(from + " cannot be read", "is it there, and may this user read it?");
        in >> text;
    } else if (text.empty()) {
        const char* value = std::getenv(variable().c_str());
        if (value == nullptr || *value == '\0') return std::optional<std::string>();
        from = variable();
        text = value;
    }
    if (auto fine = is_password(text); !fine)
        return fail(fmt::format("{}: {}", from, fine.error().what), fine.error().hint);
    return std::optional(text);
}

void add_password(CLI::App& command, Password& password, std::string name, const std::string& about) {
    password.name = std::move(name);
    auto option = "--" + password.name;
    auto* given = command.add_option(
        option, password.given,
        fmt::format("{}, 8 hex digits; also from {} in the environment", about, password.variable()));
    given->type_name("HEX");
    // CLI11 shows what was given where a check fails, so that there is none here.
    command.add_option(option + "-file", password.file, "A file that holds it, which `ps` does not show")
        ->type_name("FILE")
        ->excludes(given);
}

struct TagOptions {
    Target target;
    std::vector<std::string> words;
    Password access, kill;
    std::string tag;  // as hex
    std::string bank, antenna, technology;

    bool is_gen2() const { return technology.empty() || technology == to_text(event::Technology::epc_gen2); }
    std::optional<std::string> block;
    std::vector<std::string> fields;
    std::uint64_t offset = 0, length = 1, retries = 2, numbering_system = 0;
    CLI::Option *offset_given = nullptr, *length_given = nullptr;
    std::string data;
    bool verify = true, yes = false;
    std::string said;  // what was done, in better words than the job's own
};

// Takes the words; the error is a slip on the command line.
Result<json::object> request_of(TagOptions& options, std::string_view op,
                                std::initializer_list<std::string_view> words) {
    if (auto fine = take_words(options.target, options.words, words); !fine)
        return tl::unexpected(fine.error());
    auto id = read_tag_id(options.words[0]);
    if (!id) return fail(fmt::format("{}: {}", *words.begin(), id.error().what), id.error().hint);
    options.tag = to_hex(*id);
    json::object request;
    request["op"] = op;
    request["tag"] = options.tag;
    request["retries"] = options.retries;
    if (!options.antenna.empty()) request["antenna"] = options.antenna;
    if (!options.technology.empty()) request["technology"] = options.technology;
    return request;
}

Result<void> add_secret(json::object& request, std::string_view member, const Password& password) {
    auto text = password.read();
    if (!text) return tl::unexpected(text.error());
    if (*text) request[member] = **text;
    return {};
}

// What cannot be undone needs a word from whoever asked for it. Nothing: go on.
std::optional<int> not_confirmed(Context& context, const TagOptions& options, std::string_view verb,
                                 std::string_view question) {
    if (options.yes) return {};
    auto answer = confirmed(context, question);
    if (!answer)
        return misuse(
            context, verb,
            {fmt::format("this cannot be undone, and nobody sits at a terminal to be asked"), "add --yes"});
    if (*answer) return {};
    context.err << "nothing was done\n" << std::flush;
    return failed;
}

int run(Context& context, TagOptions& options, json::object request, std::string_view verb) {
    if (auto fine = add_secret(request, "access_password", options.access); !fine)
        return misuse(context, verb, fine.error());
    auto job = run_job(options.target, std::move(request));
    if (!job) return complain(context, verb, job.error());
    if (!options.target.json && job->at("status").get_string() == "done") {
        auto values = values_of(*job);
        auto data = std::ranges::find(values, "data", &std::pair<std::string, json::value>::first);
        if (data != values.end()) {
            context.out << plain(data->second) << '\n';
        } else {
            const auto* detail = job->if_contains("detail");
            std::string what = !options.said.empty() ? options.said : detail != nullptr ? plain(*detail) : "";
            context.out << fmt::format("done: {}{}{}\n", verb, what.empty() ? "" : ", ", what);
            for (auto& [name, value] : values)
                context.out << fmt::format("{}: {}\n", printable(name), plain(value));
        }
    }
    return conclude(context, options.target, *job, verb);
}

int read(Context& context, TagOptions& options) {
    constexpr std::string_view verb = "tag read";
    auto request = request_of(options, "tag.read", {"TAG"});
    if (!request) return misuse(context, verb, request.error());
    auto bank = parse_bank(options.bank);
    if (bank == Bank::epc && options.is_gen2() && options.offset_given->empty() &&
        options.length_given->empty()) {
        // The id itself: after the CRC and the PC, as long as the id that it was asked for by.
        options.offset = 2;
        options.length = (options.tag.size() + 3) / 4;
    }
    if (!options.bank.empty()) (*request)["bank"] = options.bank;
    (*request)["offset"] = options.offset;
    (*request)["length"] = options.length;
    return run(context, options, std::move(*request), verb);
}

int write(Context& context, TagOptions& options) {
    constexpr std::string_view verb = "tag write";
    auto request = request_of(options, "tag.write", {"TAG"});
    if (!request) return misuse(context, verb, request.error());
    auto data = read_hex(options.data);
    if (!data) return misuse(context, verb, {"--data: " + data.error().what, data.error().hint});
    if (data->empty() || (options.is_gen2() && data->size() % 2 != 0))
        return misuse(context, verb,
                      {fmt::format("--data: {} {} no whole words", data->size(),
                                   data->size() == 1 ? "byte is" : "bytes are"),
                       "a word is two bytes, like 0011"});
    if (!options.bank.empty()) (*request)["bank"] = options.bank;
    (*request)["offset"] = options.offset;
    (*request)["data"] = to_hex(*data);
    (*request)["verify"] = options.verify;
    return run(context, options, std::move(*request), verb);
}

int program(Context& context, TagOptions& options) {
    constexpr std::string_view verb = "tag program";
    auto request = request_of(options, "tag.program", {"TAG", "NEW"});
    if (!request) return misuse(context, verb, request.error());
    auto id = read_tag_id(options.words[1]);
    if (!id) return misuse(context, verb, {"NEW: " + id.error().what, id.error().hint});
    (*request)["new_tag"] = to_hex(*id);
    if (options.numbering_system != 0) (*request)["numbering_system"] = options.numbering_system;
    (*request)["verify"] = options.verify;
    return run(context, options, std::move(*request), verb);
}

bool is_number(std::string_view text) {
    auto is_digit = [](unsigned char c) { return std::isdigit(c) != 0; };
    return !text.empty() && text.size() <= 8 && std::ranges::all_of(text, is_digit);
}

int lock(Context& context, TagOptions& options) {
    constexpr std::string_view verb = "tag lock";
    // "--address 20" is no reader's address: it can only mean the memory's.
    if (!options.block && !options.target.address.empty() && is_number(options.target.address))
        options.block = std::exchange(options.target.address, {});
    auto asked = request_of(options, "tag.lock", {"TAG"});
    if (!asked) return misuse(context, verb, asked.error());
    auto& request = *asked;
    if (options.fields.empty() == !options.block)
        return misuse(context, verb,
                      {options.block ? "--field and --block do not go together" : "say what to lock",
                       "--field user=locked for Gen2 tags, --block N for others"});
    bool for_ever = options.block.has_value();
    if (options.block) {
        request["address"] = std::strtoll(options.block->c_str(), nullptr, 10);
    } else {
        json::object fields;
        for (auto& each : options.fields) {
            auto equals = each.find('=');
            auto state = each.substr(equals + 1);
            if (fields.contains(each.substr(0, equals)))
                return misuse(context, verb, {"--field " + each.substr(0, equals) + " is given twice", ""});
            fields[each.substr(0, equals)] = state;
            for_ever = for_ever || state.starts_with("permanently");
        }
        request["fields"] = std::move(fields);
    }
    if (for_ever) {
        auto question = fmt::format(
            "Lock {} of tag {} for ever?",
            options.block ? "block " + *options.block : fmt::format("{}", fmt::join(options.fields, ", ")),
            options.tag);
        if (auto end = not_confirmed(context, options, verb, question)) return *end;
        request["confirm"] = true;
    }
    if (!options.block)
        options.said = fmt::format("tag {}, {}", options.tag, fmt::join(options.fields, ", "));
    return run(context, options, std::move(request), verb);
}

int kill(Context& context, TagOptions& options) {
    constexpr std::string_view verb = "tag kill";
    auto asked = request_of(options, "tag.kill", {"TAG"});
    if (!asked) return misuse(context, verb, asked.error());
    auto& request = *asked;
    if (auto fine = add_secret(request, "kill_password", options.kill); !fine)
        return misuse(context, verb, fine.error());
    if (!request.contains("kill_password"))
        return misuse(context, verb,
                      {"a tag is killed with its kill password",
                       fmt::format("--kill-password, --kill-password-file or {}", options.kill.variable())});
    auto question = fmt::format("Kill tag {} for ever?", options.tag);
    if (auto end = not_confirmed(context, options, verb, question)) return *end;
    request["confirm"] = true;
    return run(context, options, std::move(request), verb);
}

constexpr std::array<std::string_view, 5> lock_fields = {"kill", "access", "epc", "tid", "user"};
constexpr std::array<std::string_view, 4> lock_states = {"open", "permanently_open", "locked",
                                                         "permanently_locked"};

Result<void> is_lock(const std::string& text) {
    auto equals = text.find('=');
    auto field = std::string_view(text).substr(0, equals);
    auto state = equals == std::string::npos ? std::string_view{} : std::string_view(text).substr(equals + 1);
    auto say = [](std::string_view word, std::span<const std::string_view> known) {
        auto near = nearest(word, known);
        return near.empty() ? fmt::format("one of: {}", fmt::join(known, ", "))
                            : fmt::format("did you mean {}?", near);
    };
    if (std::ranges::find(lock_fields, field) == lock_fields.end())
        return fail(fmt::format("{} has no lock", printable(field)), say(field, lock_fields));
    if (std::ranges::find(lock_states, state) == lock_states.end())
        return fail(fmt::format("{} is no state of a lock", printable(state)), say(state, lock_states));
    return {};
}

Result<void> is_bank(const std::string& text) {
    if (parse_bank(text)) return {};
    constexpr std::array<std::string_view, 4> banks = {"reserved", "epc", "tid", "user"};
    auto near = nearest(text, banks);
    return fail(fmt::format("there is no bank {}", printable(text)),
                near.empty() ? fmt::format("banks: {}", fmt::join(banks, ", "))
                             : fmt::format("did you mean {}?", near));
}

// What all of them have.
void add_tag_options(CLI::App& command, Context& context, TagOptions& options) {
    add_target(command, options.target, "The job as JSON");
    add_password(command, options.access, "access-password", "The tag's access password");
    command.add_option("--antenna", options.antenna,
                       "Only through this antenna, as the make calls it (default: whichever sees the tag)");
    add_count(command, "--retries", options.retries, 0,
              "How often to try again when the tag does not answer (default: 2)", 100);
    std::vector<std::string> technologies;
    for (auto& each : event::all_technologies())
        technologies.emplace_back(each.name);
    add_choice(command, context, "--technology", options.technology, std::move(technologies),
               "The tag's kind, if it is not epc-gen2");
}

constexpr std::uint64_t most_address = 0xFF'FFFF;  // as the gateway takes it

void add_memory(CLI::App& command, Context& context, TagOptions& options) {
    auto* bank =
        command.add_option("--bank", options.bank, "reserved, epc, tid or user (the default), or its number");
    must(*bank, is_bank);
    context.words[bank] = {"reserved", "epc", "tid", "user"};
    options.offset_given = &add_count(
        command, "--offset", options.offset, 0,
        "Where it begins: in words of 16 bits for Gen2, bytes for ISO 18000-6B, blocks for HF (default: "
        "0)",
        most_address);
}

void add_verify(CLI::App& command, TagOptions& options, const std::string& about) {
    command.add_flag("--verify,!--no-verify", options.verify, about);
}
}  // namespace

void add_tag(CLI::App& app, Context& context) {
    auto& tag =
        add_command(app, "tag", "Tags: which are there; read, write, lock or kill one in front of a reader",
                    "gantry tag list --reader dock-1\n"
                    "gantry tag read dock-1 3034257BF7194E4000001A2C --bank user --length 4\n"
                    "gantry tag write dock-1 3034257BF7194E4000001A2C --data 00112233");
    tag.require_subcommand(1);
    add_tag_list(tag, context);
    auto verb = [&](std::string_view name, std::string_view about, std::string_view examples,
                    std::initializer_list<Word> words,
                    int (*action)(Context&, TagOptions&)) -> std::pair<CLI::App&, TagOptions&> {
        auto options = std::make_shared<TagOptions>();
        auto& command = add_command(tag, name, about, examples);
        add_tag_options(command, context, *options);
        add_words(command, context, options->words, words);
        on_run(command, context, [&context, options, action] { return action(context, *options); });
        return {command, *options};
    };
    const Word reader{"READER", "The reader"}, id{"TAG", "The tag's id in hex, or as urn:epc:tag:…"};
    {
        auto [command, options] =
            verb("read", "Print what a tag's memory holds, in hex",
                 "gantry tag read dock-1 3034257BF7194E4000001A2C --bank tid --length 6\n"
                 "gantry tag read dock-1 urn:epc:tag:sgtin-96:1.0614141.812345.6700 --bank epc\n"
                 "gantry tag read dock-1 3034257BF7194E4000001A2C --offset 2 --length 4 --json",
                 {reader, id}, read);
        add_memory(command, context, options);
        options.length_given = &add_count(
            command, "--length", options.length, 1,
            "How much, in the same units: of a Gen2 tag 6 is 12 bytes (default: 1; of the bank epc the "
            "whole id)",
            0xFFFF);
    }
    {
        auto [command, options] =
            verb("write", "Write to a tag's memory, and read it back",
                 "gantry tag write dock-1 3034257BF7194E4000001A2C --bank user --data 00112233\n"
                 "gantry tag write dock-1 3034257BF7194E4000001A2C --data 0011 --offset 3 "
                 "--access-password-file secret",
                 {reader, id}, write);
        add_memory(command, context, options);
        command.add_option("--data", options.data, "What to write: whole units, in hex")->required();
        add_verify(command, options, "Read it back and compare (the default)");
    }
    {
        auto [command, options] = verb("program", "Give a tag a new id",
                                       "gantry tag program dock-1 3034257BF7194E4000001A2C "
                                       "3034257BF7194E4000001A86",
                                       {reader, id, {"NEW", "Its new id in the same way"}}, program);
        add_count(command, "--numbering-system", options.numbering_system, 0,
                  "Bits 17h to 1Fh of a Gen2 tag's PC (default: 0, an EPC)");
        add_verify(command, options, "Look for the tag under its new id (the default)");
    }
    {
        auto [command, options] =
            verb("lock", "Lock or open parts of a tag's memory",
                 "gantry tag lock dock-1 3034257BF7194E4000001A2C --field user=locked --access-password-file "
                 "secret\n"
                 "gantry tag lock dock-1 3034257BF7194E4000001A2C --field epc=permanently_locked --yes\n"
                 "gantry tag lock dock-1 E004000011223344 --technology iso18000-6b --block 20 --yes",
                 {reader, id}, lock);
        must(*command.add_option("--field", options.fields,
                                 "FIELD=STATE, also several: kill, access, epc, tid or user; open, "
                                 "permanently_open, locked or permanently_locked"),
             is_lock);
        auto* block = command.add_option(
            "--block", options.block,
            "The byte or block to lock for ever, of tags that are no Gen2 (--address N is the "
            "same)");
        must(*block, [](const std::string& text) -> Result<void> {
            if (is_number(text)) return {};
            return fail(fmt::format("{} cannot be", printable(text)), "write a whole number, 0 or more");
        });
        command.add_flag("--yes", options.yes, "Do not ask, even when it is for ever");
    }
    {
        auto [command, options] =
            verb("kill", "Silence a tag for ever",
                 "gantry tag kill dock-1 3034257BF7194E4000001A2C --kill-password-file secret\n"
                 "gantry tag kill dock-1 3034257BF7194E4000001A2C --kill-password 0000C0DE --yes",
                 {reader, id}, kill);
        add_password(command, options.kill, "kill-password", "The tag's kill password");
        command.add_flag("--yes", options.yes, "Do not ask");
    }
}

}  // namespace gantry::cli
