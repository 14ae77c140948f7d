#pragma once
#include <vector>

#include "protocols/harting/config.hpp"
#include "protocols/harting/driver_dialog.hpp"
#include "reader/observation.hpp"

namespace gantry::harting {

// What scan mode sends (section 8): a prefix once, then for each tag its id, a separator and data, and end
// characters, as CFG13 says. Takes the text between the frames of a serial line apart.
class ScanText {
public:
    static constexpr std::size_t longest_line = 1024;

    // `data`: data blocks come behind the ids (CFG11).
    void configure(const Block& scan_format, const Block& read_data);
    // Takes what belongs to whole tags from `pending_`; what is no tag is counted.
    struct Taken {
        std::uint32_t tags = 0, unusable = 0;
    };
    Taken take(ByteView text, std::vector<Observation>& out, Bytes& bank);
    void reset() { pending_.clear(); }
    std::size_t pending() const { return pending_.size(); }

private:
    bool take_line(ByteView line, std::vector<Observation>& out, Bytes& bank) const;

    bool hex_ = true, with_id_ = true, with_data_ = false;
    Bank bank_ = Bank::user;
    Bytes prefix_ = {}, separator_ = {};
    Bytes end_ = {'\r'};  // never empty
    Bytes pending_;
};

}  // namespace gantry::harting
