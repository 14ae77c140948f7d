#pragma once
#include <array>
#include <cstdint>
#include <cstring>
#include <random>

#include <boost/unordered/unordered_flat_map.hpp>

#include "journal/rows.hpp"

namespace gantry::journal {

// The numbers of the tags that were stored lately. Only memory: what it has forgotten gets a second row.
class TagDictionary {
public:
    // Beyond this many a new generation is due; at 32 bytes each about 16 MB.
    static constexpr std::size_t max_tags = 400'000;

    struct Entry {
        std::uint32_t offset;  // from the first number of this generation
        bool added;
    };
    Entry find_or_add(const TagKey& tag) {
        auto offset = static_cast<std::uint32_t>(size());
        auto rest = std::uint64_t{tag.xpc} << 32 | std::uint64_t{tag.pc} << 16 |
                    std::uint64_t{tag.tag.size} << 8 | static_cast<std::uint64_t>(tag.technology);
        if (tag.tag.size <= short_size) {
            Short key{0, 0, rest};
            std::memcpy(key.data(), tag.tag.data.data(), tag.tag.size);
            auto [it, added] = short_.try_emplace(key, offset);
            return {it->second, added};
        }
        auto [it, added] = long_.try_emplace(Long{tag.tag, rest}, offset);
        return {it->second, added};
    }
    std::size_t size() const { return short_.size() + long_.size(); }
    void clear() {
        short_.clear();
        long_.clear();
    }

private:
    // Nearly all ids have 8, 12 or 16 bytes: those are kept small, so that more of them stay in the cache.
    static constexpr std::size_t short_size = 16;
    using Short = std::array<std::uint64_t, 3>;  // the id, padded, and the rest
    struct ShortHash {
        using is_avalanching = void;
        // Secret, so that nobody can make tags that all fall on one place of the map.
        std::uint64_t secret = std::uint64_t{std::random_device{}()} << 32 | std::random_device{}();
        std::size_t operator()(const Short& key) const noexcept {
            return mix(mix(key[0] ^ secret, 0xD6E8FEB86659FD93u) ^ key[1],
                       mix(key[2] ^ secret, 0xE7037ED1A0B428DBu) | 1);
        }
        static std::uint64_t mix(std::uint64_t a, std::uint64_t b) {
            __extension__ using Wide = unsigned __int128;
            auto wide = static_cast<Wide>(a) * b;
            return static_cast<std::uint64_t>(wide) ^ static_cast<std::uint64_t>(wide >> 64);
        }
    };
    struct Long {
        event::TagId tag;
        std::uint64_t rest;
        friend bool operator==(const Long&, const Long&) = default;
    };
    struct LongHash {
        using is_avalanching = void;
        std::size_t operator()(const Long& key) const noexcept {
            return ShortHash::mix(event::TagIdHash{}(key.tag) ^ 0xD6E8FEB86659FD93u,
                                  key.rest ^ 0xE7037ED1A0B428DBu);
        }
    };
    boost::unordered_flat_map<Short, std::uint32_t, ShortHash> short_;
    boost::unordered_flat_map<Long, std::uint32_t, LongHash> long_;
};

}  // namespace gantry::journal
