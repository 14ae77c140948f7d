#include "gateway/roster.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "link/link.hpp"

namespace gantry::gateway {

RosterEntry* Roster::find(std::string_view name) {
    std::lock_guard lock(mutex_);
    auto it = std::ranges::find(entries_, name, &RosterEntry::name);
    return it == entries_.end() ? nullptr : &*it;
}

RosterEntry* Roster::admit(std::string_view name, const ReaderConfig& config) {
    std::lock_guard lock(mutex_);
    auto it = std::ranges::find(entries_, name, &RosterEntry::name);
    if (it != entries_.end()) return it->config == &config ? &*it : nullptr;
    if (entries_.size() >= max_readers) return nullptr;
    auto& entry = entries_.emplace_back();
    entry.index = static_cast<std::uint32_t>(entries_.size() - 1);
    entry.name = name;
    entry.config = &config;
    return &entry;
}

RosterEntry& Roster::at(std::uint32_t index) {
    std::lock_guard lock(mutex_);
    return entries_.at(index);
}

const RosterEntry& Roster::at(std::uint32_t index) const {
    std::lock_guard lock(mutex_);
    return entries_.at(index);
}

std::size_t Roster::size() const {
    std::lock_guard lock(mutex_);
    return entries_.size();
}

static bool may_dial_from(const ReaderConfig& section, std::string_view host) {
    return section.from.empty() ||
           std::ranges::any_of(section.from, [&](auto& net) { return link::in_network(host, net); });
}

const ReaderConfig* section_for(std::span<const ReaderConfig* const> sections, std::string_view name,
                                std::string_view host, std::string& why) {
    if (name.empty()) {  // even where * would match it: nobody could ask for such a reader
        why = "it gives no name";
        return nullptr;
    }
    const ReaderConfig* found = nullptr;
    bool name_matched = false;
    for (const auto* section : sections) {
        if (!matches(section->name, name)) continue;
        name_matched = true;
        if (!may_dial_from(*section, host)) continue;
        if (section->name == name) return section;
        if (found == nullptr) found = section;
    }
    if (found == nullptr)
        why = name_matched ? fmt::format("its address {} is outside the networks of `from`", host)
                           : std::string("no [[reader]] section has that name or a pattern for it");
    return found;
}

const ReaderConfig* section_at(std::span<const ReaderConfig* const> sections, std::string_view host,
                               std::string& name, std::string& why) {
    const ReaderConfig* found = nullptr;
    for (const auto* section : sections)
        if (may_dial_from(*section, host) &&
            (found == nullptr || (found->from.empty() && !section->from.empty())))
            found = section;
    if (found == nullptr) {
        why = fmt::format("its address {} is in no section's `from`", host);
        return nullptr;
    }
    name = found->name;
    if (auto star = name.find('*'); star != std::string::npos) name.replace(star, 1, host);
    return found;
}

}  // namespace gantry::gateway
