#pragma once
#include <string>
#include <string_view>
#include <variant>

#include <boost/json/fwd.hpp>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "wire/message.hpp"

// Messages of any protocol as JSON, the same for the command line and for programs: what `gantry decode`
// prints and `gantry encode` reads. Nothing is lost on the way: the line of a message encodes to the bytes it
// was decoded from.
namespace gantry::api {

// Numbers and booleans as themselves, bytes as upper-case hex, lists as arrays, records as objects in wire
// order.
boost::json::value to_json(const wire::Value& value);
boost::json::object to_json(const wire::Fields& fields);
// Back again; hex stays text, which is what Codec::encode takes for bytes. Numbers must be whole and fit 64
// bits with sign; null is refused.
Result<wire::Value> from_json(const boost::json::value& json);
// The fields of a message: an object, or a list of ["Name", value] pairs where a name may come twice.
Result<wire::Fields> fields_from_json(const boost::json::value& json);
boost::json::array pairs_to_json(const wire::Fields& fields);
// A value from text, as a person typed it.
Result<wire::Value> value_from_json(std::string_view text);

// Where a message or fault stands in its stream.
struct Place {
    std::size_t offset = 0;
    std::size_t length = 0;
    std::string_view protocol;
    wire::Direction direction{};
};

std::string_view to_text(wire::Direction direction);  // "to-reader", "to-host"

// One line without its newline. The members of the header stand between "message" and "fields"; none may be
// called offset, length, protocol, direction, message or fields.
std::string message_line(const Place& place, const wire::Message& message);
// Bytes that could not be decoded, whole, with the reason.
std::string error_line(const Place& place, std::string_view error, ByteView bytes);

// What a line says: a message, or the bytes of what could not be decoded.
struct Line {
    std::string protocol, direction;  // empty when the line does not say
    std::variant<wire::Message, Bytes> content;
};
// Also takes what a person writes: "fields" may be an object, and only "message" must be there.
Result<Line> parse_line(std::string_view json);

}  // namespace gantry::api
