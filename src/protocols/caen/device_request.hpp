#pragma once
#include <vector>

#include "protocols/caen/message.hpp"
#include "protocols/caen/tables.hpp"

// What a host asked of a virtual reader, checked against the command's row once, for all commands.
namespace gantry::caen {

// The attributes of a request in the places of its row.
class Arguments {
public:
    // A row may have an attribute twice: an optional one of a mask, then the command's own. at() is the
    // command's own, the last.
    const Avp* at(Attribute attribute) const;
    const Avp* of_mask(Attribute attribute) const;  // the first, where it is optional

    bool has(Attribute attribute) const { return at(attribute) != nullptr; }
    std::uint32_t number(Attribute attribute, std::uint32_t otherwise = 0) const;
    std::string_view text(Attribute attribute) const;
    ByteView bytes(Attribute attribute) const;

private:
    friend struct Checked check_request(const Parsed&, const CommandRow&, const ModelRow&, bool);
    const CommandRow* row_ = nullptr;
    std::vector<const Avp*> places_;  // one for each row_->in; nullptr: not given
};

struct Checked {
    ResultCode result = ResultCode::success;
    Arguments arguments;  // views into the request
};

// In this order: does the model have the command (206); is each attribute there, once, in its place, of its
// type and size (200); is its value one that the tables allow (128, or the code that exists for it).
// `any_order`: attributes may come in any order.
Checked check_request(const Parsed& request, const CommandRow& row, const ModelRow& model, bool any_order);

}  // namespace gantry::caen
