#pragma once
#include <cstdint>
#include <memory>

#include "reader/air.hpp"

namespace gantry::field {

struct TagSpec;

// A tag's memory and what guards it, as its technology has it: one subclass each. Knows neither place nor
// time. What a tag has no command for it does not hear: nobody answers, which is what the defaults
// here say.
class TagMemory {
public:
    virtual ~TagMemory() = default;
    TagMemory(const TagMemory&) = delete;
    TagMemory& operator=(const TagMemory&) = delete;

    const event::TagId& id() const { return id_; }  // what it answers an inventory with
    event::Technology technology() const { return technology_; }
    bool is_killed() const { return killed_; }
    // Whether the carrier is enough to store anything. A tag that lacks it looks at password, lock and
    // address all the same, and only then says so.
    void power_up(bool can_store) { can_store_ = can_store; }

    // As in Air. What is refused has changed nothing.
    virtual AirResult<Bytes> read(Bank bank, std::uint32_t word, std::uint32_t words,
                                  std::uint32_t password) const;
    virtual AirResult<void> write(Bank bank, std::uint32_t word, ByteView data, std::uint32_t password);
    virtual AirResult<void> lock(AirLock lock, std::uint32_t password);
    virtual AirResult<void> permalock(Bank bank, std::uint32_t first, ByteView mask, std::uint32_t password);
    virtual AirResult<Bytes> permalocked(Bank bank, std::uint32_t first, std::uint32_t bytes,
                                         std::uint32_t password) const;
    virtual AirResult<void> kill(std::uint32_t kill_password);
    virtual AirResult<Bytes> read_bytes(std::uint32_t address, std::uint32_t size) const;
    virtual AirResult<void> write_bytes(std::uint32_t address, ByteView data);
    virtual AirResult<void> lock_byte(std::uint32_t address);
    virtual AirResult<void> program(const event::TagId& new_id, std::uint32_t kill_password, bool lock);

protected:
    explicit TagMemory(const TagSpec& spec);
    void answer_as(const event::TagId& id) { id_ = id; }
    bool can_store() const { return can_store_; }
    // A password of zero is none: such a tag cannot be killed.
    AirResult<void> kill_if(std::uint32_t own_password, std::uint32_t password);

private:
    event::Technology technology_;
    event::TagId id_;
    bool killed_ = false;
    bool can_store_ = true;
};

std::unique_ptr<TagMemory> make_memory(const TagSpec& spec);

// Whether [first, first + count) lies within a memory of `size`, and starts there.
inline bool fits(std::size_t size, std::uint32_t first, std::size_t count) {
    return first < size && count <= size - first;
}

}  // namespace gantry::field
