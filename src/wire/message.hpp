#pragma once
#include <concepts>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/bytes.hpp"
#include "wire/error.hpp"

namespace gantry::wire {

// Which way a message travels. The same bytes can mean different things each way.
enum class Direction : std::uint8_t { to_reader, to_host };

struct Field;
using Fields = std::vector<Field>;  // in wire order

// One value of a message as people and programs see it: the generic face of a codec, for jobs, `decode`,
// the console and tests. The hot path never makes one.
struct Value {
    using List = std::vector<Value>;
    std::variant<std::int64_t, std::string, Bytes, List, Fields, bool> of;

    Value();
    template <std::integral T>
    requires(!std::same_as<T, bool>) Value(T number);  // NOLINT(google-explicit-constructor)
    Value(std::string text);                           // NOLINT(google-explicit-constructor)
    Value(Bytes bytes);                                // NOLINT(google-explicit-constructor)
    Value(List list);                                  // NOLINT(google-explicit-constructor)
    Value(Fields record);                              // NOLINT(google-explicit-constructor)
    Value(bool yes);                                   // NOLINT(google-explicit-constructor)
    Value(const char*) = delete;                       // would silently become bool
    friend bool operator==(const Value&, const Value&) = default;

    template <class T>
    const T* get() const {
        return std::get_if<T>(&of);
    }
};

struct Field {
    std::string name;
    Value value;
    friend bool operator==(const Field&, const Field&) = default;
};

// Here, because clang wants Field to be complete when a value is made.
inline Value::Value() : of(std::int64_t{0}) {}
template <std::integral T>
requires(!std::same_as<T, bool>) Value::Value(T number) : of(static_cast<std::int64_t>(number)) {}
inline Value::Value(std::string text) : of(std::move(text)) {}
inline Value::Value(Bytes bytes) : of(std::move(bytes)) {}
inline Value::Value(List list) : of(std::move(list)) {}
inline Value::Value(Fields record) : of(std::move(record)) {}
inline Value::Value(bool yes) : of(yes) {}

inline const Value* find(const Fields& fields, std::string_view name) {
    for (auto& field : fields)
        if (field.name == name) return &field.value;
    return nullptr;
}

// One message of a protocol. `header` holds what every frame of the protocol carries beside the message's own
// fields (ids, flags, status, names); `decode` prints it as members of the object, `fields` as ordered pairs.
struct Message {
    std::string
        name;  // in the protocol's own tables; "Unknown" when no row has the code, which is then in `header`
    Fields header;
    Fields fields;
    friend bool operator==(const Message&, const Message&) = default;
};

// What one step of decoding a byte stream found.
struct Decoded {
    std::size_t length = 0;  // bytes covered; 0 only with `more` or at the end
    bool more = false;       // the bytes so far are a good beginning: give more
    Result<Message> message = Message{};
};

// The generic face of a protocol: bytes to named values and back. Knows no state beyond one frame.
class Codec {
public:
    virtual ~Codec() = default;
    // Looks at the front of `input`. With `end` set no more bytes will come: what is incomplete is an error
    // then. An error covers the bytes up to where decoding goes on: the end of the frame when its length
    // could be trusted, else the next place that can start a frame, else the end.
    virtual Decoded decode(ByteView input, Direction direction, bool end) const = 0;
    // Appends the frame. Fields may be given in any order the protocol allows; names are those of the tables.
    // Values may come as a person types them: numbers and enumerations as text, bytes as hex text.
    virtual Result<void> encode(const Message& message, Direction direction, Bytes& out) const = 0;
    // Are the message's values legal by the protocol? For what a person typed, before it is sent.
    virtual Result<void> check(const Message& message, Direction direction) const = 0;
    // The names of all messages that travel this way, for completion and error hints.
    virtual std::vector<std::string_view> names(Direction direction) const = 0;
    // The names of a message's fields, for completion; empty when it has none or is unknown.
    virtual std::vector<std::string_view> field_names(std::string_view message,
                                                      Direction direction) const = 0;
    // The names that a field's value may have, for completion; empty when it is no enumeration.
    virtual std::vector<std::string_view> value_names(std::string_view /*message*/,
                                                      std::string_view /*field*/,
                                                      Direction /*direction*/) const {
        return {};
    }
    // The unit of a field's number: "mW"; empty when it has none.
    virtual std::string_view unit(std::string_view /*message*/, std::string_view /*field*/,
                                  Direction /*direction*/) const {
        return {};
    }
};

}  // namespace gantry::wire
