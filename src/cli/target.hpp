#pragma once
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>

#include <boost/json.hpp>

#include "cli/direct.hpp"
#include "cli/place.hpp"

// Where a command about a reader goes: to the running gateway, which has the reader by its name, or straight
// to the reader with --address.
namespace gantry::cli {

struct Target {
    Place place;
    std::string reader;  // by name; with an address it may be left out
    std::string address;
    std::vector<std::string> settings;  // of the make, with an address
    std::optional<std::chrono::milliseconds> timeout = 10s;
    bool json = false;

    bool direct() const { return !address.empty(); }
    std::string shown() const;  // the reader's name, or else its address
};
// -c, --data-dir, --address, --set, --timeout and --json.
void add_target(CLI::App& command, Target& target, const std::string& json_help);

// One word of the command line after another; the shell asks for what they may be.
struct Word {
    std::string name, help;
    bool is_file = false;  // then it completes files
};
void add_words(CLI::App& command, Context& context, std::vector<std::string>& words,
               std::initializer_list<Word> all);
// The words begin with the reader's name, which may be missing with an address; takes it off and leaves as
// many as `rest` names.
Result<void> take_words(Target& target, std::vector<std::string>& words,
                        std::initializer_list<std::string_view> rest);

// The make of the target's reader.
Result<const Plugin*> make_of(const Target& target);
// The reader itself, for a target with an address.
Result<std::unique_ptr<DirectReader>> open_direct(const Target& target, bool reading = false,
                                                  std::function<bool()> interrupted = {});

// Runs jobs as the interface has them, {"op":"tag.read",…}, from job_run.cpp; with an address over one link.
// What comes back has the same members either way: "status", "text", "values". Ctrl-C takes a job back: then
// there is "interrupted" too, and "status" and "text" say what became of it.
class JobRunner {
public:
    explicit JobRunner(const Target& target);  // which must live as long
    ~JobRunner();
    Result<boost::json::object> run(boost::json::object request);

private:
    class Direct;
    const Target& target_;
    std::unique_ptr<Direct> direct_;
};
// One job alone.
Result<boost::json::object> run_job(const Target& target, boost::json::object request);

}  // namespace gantry::cli
