#pragma once
#include <mutex>

#include "field/memory.hpp"
#include "reader/air.hpp"

namespace gantry::field {

// Access to tags with memory, for any field: it only has to say who answers. All airs of a field share its
// mutex; each call is short.
class AccessAir : public Air {
public:
    AirResult<Bytes> read(const AirAccess& access, Bank bank, std::uint32_t word,
                          std::uint32_t words) override {
        return reading(access, [&](TagMemory& tag) { return tag.read(bank, word, words, access.password); });
    }
    AirResult<void> write(const AirAccess& access, Bank bank, std::uint32_t word, ByteView data) override {
        return writing(access, [&](TagMemory& tag) { return tag.write(bank, word, data, access.password); });
    }
    AirResult<void> lock(const AirAccess& access, AirLock lock) override {
        return writing(access, [&](TagMemory& tag) { return tag.lock(lock, access.password); });
    }
    AirResult<void> permalock(const AirAccess& access, Bank bank, std::uint32_t first,
                              ByteView mask) override {
        return writing(access,
                       [&](TagMemory& tag) { return tag.permalock(bank, first, mask, access.password); });
    }
    AirResult<Bytes> permalocked(const AirAccess& access, Bank bank, std::uint32_t first,
                                 std::uint32_t bytes) override {
        return reading(access,
                       [&](TagMemory& tag) { return tag.permalocked(bank, first, bytes, access.password); });
    }
    AirResult<void> kill(const AirAccess& access, std::uint32_t password) override {
        return writing(access, [&](TagMemory& tag) { return tag.kill(password); });
    }

    AirResult<Bytes> read_bytes(const AirAccess& access, std::uint32_t address, std::uint32_t size) override {
        return reading(access, [&](TagMemory& tag) { return tag.read_bytes(address, size); });
    }
    AirResult<void> write_bytes(const AirAccess& access, std::uint32_t address, ByteView data) override {
        return writing(access, [&](TagMemory& tag) { return tag.write_bytes(address, data); });
    }
    AirResult<void> lock_byte(const AirAccess& access, std::uint32_t address) override {
        return writing(access, [&](TagMemory& tag) { return tag.lock_byte(address); });
    }

    AirResult<void> program(const AirAccess& access, const event::TagId& new_id, std::uint32_t kill_password,
                            bool lock) override {
        return writing(access, [&](TagMemory& tag) { return tag.program(new_id, kill_password, lock); });
    }

protected:
    explicit AccessAir(std::mutex& mutex) : mutex_(mutex) {}
    std::mutex& mutex() { return mutex_; }

    // Both with the mutex held. The tag of that id which answers now, told whether it has the power to store
    // (TagMemory::power_up()); or nobody.
    virtual TagMemory* reach(const AirAccess& access) = 0;
    // It answers to another id from now on.
    virtual void renamed(const event::TagId& before, const TagMemory& memory) = 0;

private:
    template <class Work>
    AirResult<Bytes> reading(const AirAccess& access, Work work) {
        std::lock_guard lock(mutex_);
        auto* tag = reach(access);
        if (tag == nullptr) return tl::unexpected(AirError::no_tag);
        return work(*tag);
    }
    template <class Work>
    AirResult<void> writing(const AirAccess& access, Work work) {
        std::lock_guard lock(mutex_);
        auto* tag = reach(access);
        if (tag == nullptr) return tl::unexpected(AirError::no_tag);
        auto done = work(*tag);
        if (!(tag->id() == access.tag)) renamed(access.tag, *tag);
        return done;
    }

    std::mutex& mutex_;
};

}  // namespace gantry::field
