// gantry reader config apply: sets what a file says and the reader has not yet.
#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "cli/job_text.hpp"
#include "cli/parameter_session.hpp"
#include "cli/reader_commands.hpp"

namespace gantry::cli {

namespace json = boost::json;

namespace {
struct Change {
    const FileParameter* wanted = nullptr;
    std::string now;  // of the reader; empty: it tells nobody
};

json::array list_of(const std::vector<const FileParameter*>& parameters) {
    json::array names;
    for (const auto* each : parameters)
        names.emplace_back(std::string(each->row->name));
    return names;
}

class Apply {
public:
    Apply(Context& context, const ParameterOptions& options, const Plugin& make,
          const std::vector<FileParameter>& file)
        : context_(context), options_(options), make_(make), file_(file), session_(context, options, verb) {}

    int run() {
        if (auto looked = look(); !looked) return looked.error().code;
        if (auto code = check(); code != done) return code;
        if (options_.dry_run) return report(done);
        // Raw bytes first, and another look after them: they may have changed what was right before.
        if (!set_some(true)) return report(failed);
        if (!set_.empty())
            if (auto looked = look(); !looked) return report(looked.error().code);
        if (!set_some(false)) return report(failed);
        if (!set_.empty())
            if (auto code = verify(); code != done) return report(code);
        return report(restart());
    }

    static constexpr std::string_view verb = "reader config apply";

private:
    // Finds out what is to be done.
    tl::expected<void, Ended> look() {
        todo_.clear();
        auto now = session_.get(false);
        if (!now) return tl::unexpected(now.error());
        ParameterValues stored;
        if (options_.permanent) {
            auto values = session_.get(true);
            if (!values) return tl::unexpected(values.error());
            stored = std::move(*values);
        }
        for (auto& wanted : file_) {
            auto& row = *wanted.row;
            // What takes effect only after a restart is not at work yet, however well it is stored.
            bool stores = options_.permanent && row.permanent;
            bool stored_wrong = stores && differs(make_, wanted, stored);
            // What takes effect only after a restart is not at work yet, however well it is stored.
            bool wrong = stored_wrong || (!(stores && row.needs_restart) && differs(make_, wanted, *now));
            bool is_done = std::ranges::find(set_, &wanted, &Change::wanted) != set_.end();
            if (row.secret ? is_done : !wrong) continue;
            const auto* value = find(stored_wrong ? stored : *now, row.name);
            todo_.push_back({&wanted, value != nullptr ? plain(*value) : ""});
        }
        std::ranges::stable_sort(todo_, {}, [](auto& each) { return each.wanted->row->order; });
        return {};
    }

    // What cannot be done stops all of it, before anything is changed.
    int check() {
        std::string findings;
        for (auto& [wanted, now] : todo_)
            if (!wanted->row->writable)
                findings += fmt::format("{}:{}:{}: {} can only be read, and is {}\n", shown_file(),
                                        wanted->at.line, wanted->at.column, wanted->row->name,
                                        now.empty() ? "not known to this reader" : now);
        context_.err << findings;
        return findings.empty() ? done : failed;
    }

    bool set_some(bool raw) {
        while (!todo_.empty()) {
            auto each = todo_.front();
            if (raw && !each.wanted->row->raw) return true;
            if (auto fine = session_.set(*each.wanted->row, each.wanted->typed); !fine) {
                refusal_ = fine.error();
                refused_ = each.wanted;
                return false;
            }
            todo_.erase(todo_.begin());
            set_.push_back(each);
        }
        return true;
    }

    // Did the reader keep what it accepted?
    int verify() {
        if (auto looked = look(); !looked) return looked.error().code;
        std::vector<const FileParameter*> others;
        for (auto& each : todo_)
            if (!each.wanted->row->secret) others.push_back(each.wanted);
        todo_.clear();
        if (others.empty()) return done;
        unkept_ = std::move(others);
        refusal_ =
            Error{fmt::format("the reader took it, but has another value still: {}", names_of(unkept_))};
        return failed;
    }

    std::vector<const FileParameter*> waiting() const {
        std::vector<const FileParameter*> out;
        for (auto& each : set_)
            if (each.wanted->row->needs_restart) out.push_back(each.wanted);
        return out;
    }

    int restart() {
        if (!options_.restart || waiting().empty()) return done;
        auto restarted = session_.restart();
        restarted_ = restarted.has_value();
        return restarted ? done : restarted.error().code;
    }

    int report(int code) {
        if (session_.interrupted()) code = stopped_by_user;
        options_.target.json ? report_json() : report_text();
        if (!refusal_) return code;
        context_.out << std::flush;
        auto error = *refusal_;
        if (refused_ != nullptr) {
            std::vector<const FileParameter*> left;
            for (auto& each : todo_)
                if (each.wanted != refused_) left.push_back(each.wanted);
            auto before = set_.empty() ? std::string("nothing was set before it")
                                       : fmt::format("{} set before it", set_.size());
            error.hint += fmt::format("{}{}{}", error.hint.empty() ? "" : "; ", before,
                                      left.empty() ? "" : "; not set: " + names_of(left));
        }
        complain(context_, verb, error);
        return code;
    }

    void report_text() {
        auto name = options_.target.shown();
        auto& listed = options_.dry_run ? todo_ : set_;
        for (auto& [wanted, now] : listed)
            context_.out << fmt::format("{}: {} -> {}\n", wanted->row->name,
                                        wanted->row->secret ? "***"
                                        : now.empty()       ? "?"
                                                            : now,
                                        wanted->row->secret ? "***" : text_of(*wanted));
        if (listed.empty() && !refusal_)
            context_.out << fmt::format("{} is as {} says: nothing to do\n", name, shown_file());
        else if (options_.dry_run)
            context_.out << fmt::format("{} of {} would be set\n", listed.size(), file_.size());
        else if (!refusal_)
            context_.out << fmt::format("{} of {} set{}\n", listed.size(), file_.size(),
                                        options_.permanent ? ", also over a power-down" : "");
        if (options_.dry_run) return;
        auto waits = waiting();
        if (restarted_)
            context_.out << fmt::format("{} restarts, for {}\n", name, names_of(waits));
        else if (!waits.empty() && options_.permanent)
            context_.out << fmt::format("after `gantry reader restart`: {}\n", names_of(waits));
        else if (!waits.empty())
            context_.out << fmt::format(
                "without effect until it is set with --permanent, and a restart: {}\n", names_of(waits));
    }

    void report_json() {
        json::object out;
        out["reader"] = options_.target.shown();
        out["permanent"] = options_.permanent;
        out["dry_run"] = options_.dry_run;
        json::array changes;
        for (auto& [wanted, now] : options_.dry_run ? todo_ : set_) {
            json::object change;
            change["parameter"] = std::string(wanted->row->name);
            if (!wanted->row->secret) {
                change["from"] = now;
                change["to"] = text_of(*wanted);
            }
            changes.push_back(std::move(change));
        }
        out[options_.dry_run ? "would_set" : "set"] = std::move(changes);
        if (!options_.dry_run) {
            std::vector<const FileParameter*> left;
            for (auto& each : todo_)
                left.push_back(each.wanted);
            out["not_set"] = list_of(left);
            if (!unkept_.empty()) out["not_kept"] = list_of(unkept_);
            out["needs_restart"] = list_of(restarted_ ? std::vector<const FileParameter*>{} : waiting());
            out["restarted"] = restarted_;
        }
        context_.out << api::json_text(out) << '\n';
    }

    std::string shown_file() const {
        auto& file = options_.words[0];
        return file == "-" ? "stdin" : printable(file);
    }

    Context& context_;
    const ParameterOptions& options_;
    const Plugin& make_;
    const std::vector<FileParameter>& file_;
    ParameterSession session_;
    std::vector<Change> todo_, set_;
    const FileParameter* refused_ = nullptr;
    std::optional<Error> refusal_;
    std::vector<const FileParameter*> unkept_;
    bool restarted_ = false;
};

int apply(Context& context, ParameterOptions& options) {
    auto verb = Apply::verb;
    auto& target = options.target;
    if (auto fine = take_words(target, options.words, {"FILE"}); !fine)
        return misuse(context, verb, fine.error());
    if (options.restart && !options.permanent)
        return misuse(context, verb,
                      {"a restart would undo what is not permanent", "add --permanent, or leave --restart"});
    auto make = make_of(target);
    if (!make) return complain(context, verb, make.error());
    auto file = read_parameters(context, options.words[0], **make);
    if (!file) {
        context.err << file.error().text() << '\n';
        return failed;
    }
    return Apply(context, options, **make, *file).run();
}
}  // namespace

void add_reader_config_apply(CLI::App& config, Context& context) {
    {
        auto options = std::make_shared<ParameterOptions>();
        auto& command = add_command(config, "apply",
                                    "Set what a file says and the reader has not yet, and nothing else. "
                                    "Stops when the reader refuses, "
                                    "and says what was set by then",
                                    "gantry reader config apply dock-1 dock-1.toml --dry-run\n"
                                    "gantry reader config apply dock-1 dock-1.toml --permanent --restart");
        add_target(command, options->target, "What was set, as one JSON object");
        add_words(command, context, options->words,
                  {{"READER", "The reader"}, {"FILE", "As dump writes it; - for the standard input", true}});
        command.add_flag("--permanent", options->permanent, "Also for after a power-down");
        command.add_flag("--restart", options->restart,
                         "Restart the reader if something that was set needs it; else it says so");
        command.add_flag("--dry-run", options->dry_run, "Only say what would be set");
        on_run(command, context, [&context, options] { return apply(context, *options); });
    }
}

}  // namespace gantry::cli
