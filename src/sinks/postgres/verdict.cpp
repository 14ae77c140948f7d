#include "sinks/postgres/verdict.hpp"

#include <algorithm>
#include <array>

namespace gantry::sinks::postgres {

namespace {

// By the beginning of the SQLSTATE (PostgreSQL manual, appendix A); the longest one that fits decides.
struct Verdict {
    std::string_view beginning;
    bool row;
};
constexpr std::array verdicts = {
    Verdict{"", true},     // what is not below was made up by somebody's trigger: RAISE … ERRCODE
    Verdict{"0", false},   // connection, triggers that do not work, what the server does not support
    Verdict{"2", false},   // states of transactions, authorization
    Verdict{"21", true},   // a trigger found more rows than it can take
    Verdict{"22", true},   // data: a value that cannot be stored
    Verdict{"23", true},   // a constraint
    Verdict{"3", false},   // names of databases and schemas, external routines
    Verdict{"4", false},   // serialization, deadlock, what is not there or not allowed
    Verdict{"44", true},   // WITH CHECK OPTION
    Verdict{"53", false},  // disk full, out of memory, too many connections
    Verdict{"54", true},   // a row too long for an index
    Verdict{"55", false},  // locked by somebody, not ready
    Verdict{"57", false},  // cancelled, shut down
    Verdict{"58", false},  // input and output
    Verdict{"72", false},  // snapshot too old
    Verdict{"F0", false},  // the server's configuration
    Verdict{"HV", false},  // foreign data wrappers
    Verdict{"P0", true},   // raised in PL/pgSQL
    Verdict{"XX", false},  // the server is damaged
};

}  // namespace

bool blames_a_row(const Failure& failure) {
    if (failure.sqlstate.size() != 5) return false;
    // Row-level security refuses single rows with the SQLSTATE of a missing privilege.
    if (failure.sqlstate == "42501") return failure.routine == "ExecWithCheckOptions";
    const Verdict* longest = &verdicts.front();
    for (auto& verdict : verdicts)
        if (std::string_view(failure.sqlstate).starts_with(verdict.beginning) &&
            verdict.beginning.size() >= longest->beginning.size())
            longest = &verdict;
    return longest->row;
}

}  // namespace gantry::sinks::postgres
