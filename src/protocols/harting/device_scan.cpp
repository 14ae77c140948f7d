#include "protocols/harting/device_scan.hpp"

#include <algorithm>

namespace gantry::harting {

static void append(ByteView bytes, bool ascii, Bytes& out) {
    if (!ascii) {
        out.insert(out.end(), bytes.begin(), bytes.end());
        return;
    }
    auto hex = to_hex(bytes);
    out.insert(out.end(), hex.begin(), hex.end());
}

// The UID is what later commands would address the tag by: the EPC, or the TID where the two are read.
static ByteView uid_of(const TagRecord& tag) {
    auto identity = take_apart(tag.transponder_type, tag.iddt, tag.idd);
    if (!identity) return tag.idd;
    return identity->tid.empty() ? identity->epc : identity->tid;
}

static ByteView part_of(ByteView data, const Setup& setup) {
    data = data.subspan(std::min(setup.scan_first, data.size()));
    return data.first(std::min(setup.scan_size, data.size()));
}

void append_scan(const std::vector<TagRecord>& tags, const Setup& setup, Bytes& out) {
    auto& scan = setup.scan;
    if (tags.empty()) return;
    if (setup.prefix_address) append(Bytes{setup.address}, scan.ascii, out);
    out.insert(out.end(), scan.prefix.begin(), scan.prefix.end());
    for (auto& tag : tags) {
        bool id = (setup.tr1 & tr1_idd) != 0, data = (setup.tr1 & tr1_blocks) != 0;
        if (id) append(uid_of(tag), scan.ascii, out);
        if (id && data) out.insert(out.end(), scan.separator.begin(), scan.separator.end());
        if (data) append(part_of(tag.blocks, setup), scan.ascii, out);
        out.insert(out.end(), scan.end.begin(), scan.end.end());
    }
}

}  // namespace gantry::harting
