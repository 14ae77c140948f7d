#pragma once
#include <memory>
#include <optional>
#include <string>

#include "sink/sink.hpp"
#include "sinks/jsonl/keeper.hpp"
#include "sinks/jsonl/line_file.hpp"

namespace gantry::sinks::jsonl {

extern const sink::Kind kind;

struct Rotation {
    std::uint64_t size = 0;             // bytes that a file may have; one batch is never split over two
    std::chrono::microseconds after{};  // zero: never by age
};

// Appends each event as a line; accepted is what is on disk.
class Jsonl final : public sink::Sink {
public:
    Jsonl(const Keeping& keeping, Rotation rotation)
        : keeping_(keeping), rotation_(rotation), keeper_(keeping) {}

    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override;
    void idle(const sink::Patience& patience) override;
    bool connected() const override { return file_.has_value(); }

private:
    Result<void> get_ready(std::uint64_t bytes);
    Result<void> open_newest();
    Result<void> begin_file(std::uint64_t number);
    Result<void> write(std::span<const sink::Item> batch);
    bool is_old() const;
    std::string path_of(std::uint64_t number) const;

    const Keeping keeping_;
    const Rotation rotation_;
    std::optional<LineFile> file_;
    std::uint64_t number_ = 0;  // of `file_`
    Steady old_at_{};           // when `file_` is old
    std::string buffer_;
    Keeper keeper_;
};

}  // namespace gantry::sinks::jsonl
