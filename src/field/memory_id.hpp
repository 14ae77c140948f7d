#pragma once
#include "field/memory.hpp"

namespace gantry::field {

// EPC Class 1 Gen1: an id that can be programmed until it is locked, and a kill code of 16 bits (as far as
// readers hand it over) that is programmed with it.
class EpcGen1Memory final : public TagMemory {
public:
    explicit EpcGen1Memory(const TagSpec& spec);

    AirResult<void> program(const event::TagId& new_id, std::uint32_t kill_password, bool lock) override;
    AirResult<void> kill(std::uint32_t kill_password) override;

private:
    std::uint32_t kill_code_;
    bool locked_ = false;
};

// EPC 1.19: an id that can be programmed, without code or lock.
class Epc119Memory final : public TagMemory {
public:
    explicit Epc119Memory(const TagSpec& spec);

    AirResult<void> program(const event::TagId& new_id, std::uint32_t kill_password, bool lock) override;
};

}  // namespace gantry::field
