#pragma once
#include <span>
#include <string>
#include <string_view>

#include "sink/sink.hpp"

// Events as rows: which columns there are, and the binary format of COPY (PostgreSQL manual, "COPY").
namespace gantry::sinks::postgres {

// Appends the fields of one row. PostgreSQL's texts have no U+0000: it is written as U+2400, and told by
// has_nul().
class RowWriter {
public:
    explicit RowWriter(std::string& out) : out_(&out) {}
    void null();
    void text(std::string_view value);  // empty: null. What is not UTF-8 becomes U+FFFD, as in JSON
    void raw(std::string_view value);
    void smallint(std::int16_t value);
    void bigint(std::int64_t value);
    void boolean(bool value);
    void number(double value);
    void time(Wall value);
    void json(std::string_view value);  // jsonb
    bool has_nul() const { return has_nul_; }

private:
    void size(std::size_t bytes);
    void big_endian(std::uint64_t value, std::size_t bytes);

    std::string* out_;
    bool has_nul_ = false;
};

struct Column {
    std::string_view name;
    std::string_view type;
    void (*put)(RowWriter& row, const sink::Item& item);
};
// The columns of the table of events, named as the fields of an event's JSON, and `exact`.
std::span<const Column> columns();

// "<gateway>:<epoch>:<seq>" or "<gateway>:<seq>": the epoch, 0 where there is none.
std::uint64_t epoch_of(std::string_view id, std::string_view gateway);

// COPY's data: first the header, then rows, each the columns() and the epoch, then the end.
void append_copy_header(std::string& out);
void append_copy_row(std::string& out, const sink::Item& item, std::string_view gateway);
void append_copy_end(std::string& out);

}  // namespace gantry::sinks::postgres
