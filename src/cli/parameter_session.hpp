#pragma once
#include <boost/json.hpp>

#include "cli/parameter_file.hpp"
#include "cli/target.hpp"

// What `gantry reader config dump`, `diff` and `apply` share.
namespace gantry::cli {

struct ParameterOptions {
    Target target;
    std::vector<std::string> words;
    std::string output;
    bool permanent = false, restart = false, dry_run = false;
};

// What did not end well was told; the exit code.
struct Ended {
    int code = failed;
};

// The jobs of one such command.
class ParameterSession {
public:
    ParameterSession(Context& context, const ParameterOptions& options, std::string_view verb)
        : context_(context), options_(options), verb_(verb), jobs_(options.target) {}

    // What the reader says of itself: at work, or as it is stored.
    tl::expected<ParameterValues, Ended> get(bool permanent);
    Result<void> set(const ParameterRow& row, const std::string& typed);  // the error is what it says
    tl::expected<void, Ended> restart();
    bool interrupted() const { return interrupted_; }

private:
    tl::expected<boost::json::object, Ended> run(boost::json::object request);

    Context& context_;
    const ParameterOptions& options_;
    std::string_view verb_;
    JobRunner jobs_;
    bool interrupted_ = false;
};

const boost::json::value* find(const ParameterValues& values, std::string_view name);
// Does the reader have another value than the file, or none?
bool differs(const Plugin& make, const FileParameter& wanted, const ParameterValues& values);
std::string text_of(const FileParameter& wanted);  // as the reader would show it, made safe
std::string names_of(const std::vector<const FileParameter*>& parameters);  // "Power, Protocol"

}  // namespace gantry::cli
