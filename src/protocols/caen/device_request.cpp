#include "protocols/caen/device_request.hpp"

#include <algorithm>
#include <array>

namespace gantry::caen {

// --- arguments ---------------------------------------------------------------------------------------------

const Avp* Arguments::at(Attribute attribute) const {
    for (auto i = places_.size(); i-- > 0;)
        if (row_->in[i].attribute == attribute) return places_[i];
    return nullptr;
}

const Avp* Arguments::of_mask(Attribute attribute) const {
    for (std::size_t i = 0; i < places_.size(); ++i)
        if (row_->in[i].attribute == attribute) return row_->in[i].optional ? places_[i] : nullptr;
    return nullptr;
}

std::uint32_t Arguments::number(Attribute attribute, std::uint32_t otherwise) const {
    const auto* avp = at(attribute);
    return avp != nullptr ? avp->number().value_or(otherwise) : otherwise;
}

std::string_view Arguments::text(Attribute attribute) const {
    const auto* avp = at(attribute);
    return avp != nullptr ? avp->text() : std::string_view{};
}

ByteView Arguments::bytes(Attribute attribute) const {
    const auto* avp = at(attribute);
    return avp != nullptr ? avp->value : ByteView{};
}

// --- places ------------------------------------------------------------------------------------------------

using Places = std::vector<const Avp*>;

static std::ptrdiff_t required_after(std::span<const Param> in, std::size_t place) {
    return std::ranges::count_if(in.subspan(place + 1), [&](auto& param) {
        return param.attribute == in[place].attribute && !param.optional;
    });
}

// One client always sends the password, and without any bytes where it has none.
static bool left_out(const Param& param, const Avp& avp) {
    return param.optional && avp.value.empty() && row_of(param.attribute).kind == Kind::number;
}

// An optional place takes an attribute only where enough of them are left for the places that need one:
// G2Read has an optional bank and address for its mask, and its own after them.
static bool fill_in_order(std::span<const Param> in, std::span<const Avp> given, Places& places) {
    std::size_t next = 0;
    for (std::size_t i = 0; i < in.size(); ++i) {
        bool here = next < given.size() && given[next].is(in[i].attribute);
        if (here && in[i].optional)
            here = std::ranges::count_if(given.subspan(next), [&](auto& avp) {
                       return avp.is(in[i].attribute);
                   }) > required_after(in, i);
        if (!here && !in[i].optional) return false;
        if (!here) continue;
        if (!left_out(in[i], given[next])) places[i] = &given[next];
        ++next;
    }
    return next == given.size();
}

static bool fill_in_any_order(std::span<const Param> in, std::span<const Avp> given, Places& places) {
    std::vector<bool> used(given.size());
    for (std::size_t i = 0; i < in.size(); ++i) {
        std::ptrdiff_t left = 0;
        std::size_t first = given.size();
        for (auto j = given.size(); j-- > 0;)
            if (!used[j] && given[j].is(in[i].attribute)) {
                ++left;
                first = j;
            }
        if (left > (in[i].optional ? required_after(in, i) : 0)) {
            if (!left_out(in[i], given[first])) places[i] = &given[first];
            used[first] = true;
        } else if (!in[i].optional) {
            return false;
        }
    }
    return std::ranges::find(used, false) == used.end();
}

// --- values ------------------------------------------------------------------------------------------------

static bool right_size(const AttributeRow& row, ByteView value) {
    switch (row.kind) {
        case Kind::number:
        case Kind::integer:
        case Kind::real:
        case Kind::timestamp:
            return value.size() == row.size;
        case Kind::text:
            return value.size() <= row.size;
        case Kind::bytes:
            // None at all is what clients send where they have no mask (section 7).
            return row.size == 0 || value.size() <= row.size;
    }
    return false;
}

static bool allowed_value(const AttributeRow& row, const Avp& avp) {
    auto number = avp.number();
    if (row.kind != Kind::number || !number) return true;
    std::int64_t value = *number;
    if (row.min <= row.max && (value < row.min || value > row.max)) return false;
    return row.enumeration == nullptr || row.enumeration->find(value) != nullptr;
}

// Section 5 has a code of its own for some.
static ResultCode not_allowed(Attribute attribute) {
    switch (attribute) {
        case Attribute::protocol:
            return ResultCode::invalid_protocol;
        case Attribute::power_set:
            return ResultCode::power_out_of_range;
        case Attribute::tag_id_len:
            return ResultCode::invalid_parameter;
        default:
            return ResultCode::bad_parameter_value;
    }
}

static ResultCode check_values(const CommandRow& row, const Places& places) {
    for (std::size_t i = 0; i < places.size(); ++i)
        if (places[i] != nullptr && !right_size(row_of(row.in[i].attribute), places[i]->value))
            return ResultCode::invalid_parameter;
    for (std::size_t i = 0; i < places.size(); ++i)
        if (places[i] != nullptr && !allowed_value(row_of(row.in[i].attribute), *places[i]))
            return not_allowed(row.in[i].attribute);
    return ResultCode::success;
}

// --- forms that only some models take (section 6.2) --------------------------------------------------------

static constexpr std::array<std::string_view, 2> access_by_mask = {"A528B", "all"};
static constexpr std::array<std::string_view, 6> inventory_by_bank = {"A528B",  "R1230CB", "R1260I",
                                                                      "R1260U", "R1260E",  "all"};

static bool model_takes(const ModelRow& model, const CommandRow& row, const Arguments& arguments) {
    auto has = [](auto& names, auto& name) { return std::ranges::find(names, name) != names.end(); };
    auto masked = arguments.of_mask(Attribute::memory_bank) != nullptr;
    switch (static_cast<Command>(row.code)) {
        case Command::inventory_tag:
            return !masked || has(inventory_by_bank, model.name);
        case Command::g2_read:
        case Command::g2_write:
        case Command::g2_lock:
            // Revision 4 has no access password; it appears by revision 12.
            if (model.revision < 12 && arguments.has(Attribute::g2_password)) return false;
            return !masked || has(access_by_mask, model.name);
        case Command::g2_kill:
            return !masked || has(access_by_mask, model.name);
        case Command::g2_program_id:
            return model.revision >= 12 || !arguments.has(Attribute::g2_password);
        default:
            return true;
    }
}

Checked check_request(const Parsed& request, const CommandRow& row, const ModelRow& model, bool any_order) {
    if (!has(model, row)) return {ResultCode::invalid_function, {}};
    // How to ask for these is not published. Two of them mean something without parameters, and that is how
    // clients send them when they start (section 6).
    if (!row.parameters_known) {
        bool bare = request.avps.empty() && !request.fault && !request.result;
        bool plain = row.code == static_cast<std::uint16_t>(Command::clear_buffer) ||
                     row.code == static_cast<std::uint16_t>(Command::g2_reset_session);
        return {bare && plain ? ResultCode::success : ResultCode::unsupported, {}};
    }
    Checked checked;
    auto& arguments = checked.arguments;
    arguments.row_ = &row;
    arguments.places_.assign(row.in.size(), nullptr);
    auto fill = any_order ? fill_in_any_order : fill_in_order;
    bool placed = !request.fault && !request.result && fill(row.in, request.avps, arguments.places_);
    checked.result = placed ? check_values(row, arguments.places_) : ResultCode::invalid_parameter;
    if (checked.result != ResultCode::success) return checked;
    const auto* size = arguments.at(Attribute::tag_id_len);
    bool fits = size == nullptr || arguments.bytes(Attribute::tag_id).size() == size->number();
    if (!fits || !model_takes(model, row, arguments)) checked.result = ResultCode::invalid_parameter;
    return checked;
}

}  // namespace gantry::caen
