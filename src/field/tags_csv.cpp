#include <algorithm>
#include <array>
#include <charconv>
#include <map>

#include <fmt/format.h>

#include "base/text.hpp"
#include "field/field.hpp"
#include "field/memory_6b.hpp"
#include "field/tags.hpp"

namespace gantry::field {

namespace {

constexpr std::array<std::string_view, 9> column_names = {
    "epc", "tid", "user", "access_password", "kill_password", "technology", "antenna", "rssi_dbm", "xpc"};
constexpr std::size_t uid_size = Iso6bMemory::id_size;  // and of HF tags
constexpr std::size_t most_user_6b = Iso6bMemory::max_size - uid_size;

// Fields of one line; one in double quotes may hold commas, and "" for a quote.
std::vector<std::string> split(std::string_view line) {
    std::vector<std::string> fields(1);
    bool quoted = false;
    for (std::size_t i = 0; i < line.size(); ++i) {
        if (line[i] == '"') {
            if (quoted && i + 1 < line.size() && line[i + 1] == '"')
                fields.back() += line[++i];
            else
                quoted = !quoted;
        } else if (line[i] == ',' && !quoted) {
            fields.emplace_back();
        } else {
            fields.back() += line[i];
        }
    }
    for (auto& field : fields)
        field = std::string(trimmed(field));
    return fields;
}

class TagsFile {
public:
    explicit TagsFile(std::string_view name) : name_(printable(name)) {}

    void line(std::string_view text) {
        ++line_;
        text = trimmed(text);
        if (text.empty()) return;
        auto fields = split(text);
        if (header_.empty()) return header(fields);
        if (fields.size() > header_.size()) {
            wrong("", fmt::format("{} fields, but the header names {}", fields.size(), header_.size()));
            return;
        }
        row(fields);
    }

    Result<std::vector<PlacedTag>> finish() && {
        if (header_.empty() && errors_.empty())
            return fail(name_ + ": the file is empty",
                        "the first line names the columns, such as epc,antenna");
        if (errors_.empty()) return std::move(tags_);
        return fail(std::move(errors_));
    }
    bool given_up() const { return header_refused_ || error_count_ >= 20; }

private:
    void wrong(std::string_view column, std::string_view what) {
        if (!errors_.empty()) errors_ += '\n';
        errors_ += fmt::format("{}:{}: {}{}{}", name_, line_, column, column.empty() ? "" : ": ", what);
        ++error_count_;
    }

    void header(const std::vector<std::string>& fields) {
        for (auto& field : fields) {
            header_.push_back(field);
            if (std::ranges::find(column_names, field) == column_names.end()) {
                auto near = nearest(field, column_names);
                auto hint = near.empty() ? fmt::format("known are {}", fmt::join(column_names, ", "))
                                         : fmt::format("did you mean {}?", near);
                wrong(printable(field), "there is no such column; " + hint);
            } else if (std::ranges::count(header_, field) > 1) {
                wrong(field, "this column is named twice");
            }
        }
        header_refused_ = error_count_ > 0;
    }

    void row(const std::vector<std::string>& fields) {
        PlacedTag placed;
        auto& tag = placed.tag;
        Bytes epc;
        auto errors_before = error_count_;
        for (std::size_t i = 0; i < fields.size(); ++i) {
            const auto& column = header_[i];
            const auto& text = fields[i];
            if (text.empty()) continue;
            if (column == "epc")
                epc = hex(column, text);
            else if (column == "tid")
                tag.tid = hex(column, text);
            else if (column == "user")
                tag.user = hex(column, text);
            else if (column == "access_password")
                tag.access_password = password(column, text);
            else if (column == "kill_password")
                tag.kill_password = password(column, text);
            else if (column == "technology")
                tag.technology = technology(column, text);
            else if (column == "antenna")
                placed.antenna = antenna(column, text);
            else if (column == "xpc")
                tag.xpc = xpc(column, text);
            else
                placed.rssi_dbm = rssi(column, text);
        }
        if (error_count_ > errors_before) return;
        check_sizes(epc, tag);
        if (error_count_ > errors_before) return;
        tag.id = epc.empty() ? made_id(tag.technology) : event::TagId(epc);
        auto [known, is_new] = lines_.emplace(to_hex(tag.id.view()), line_);
        if (!is_new) {
            wrong("epc", fmt::format("{} is on line {} already", known->first, known->second));
            return;
        }
        tags_.push_back(std::move(placed));
    }

    void check_sizes(const Bytes& epc, const TagSpec& tag) {
        using event::Technology;
        auto technology = event::to_text(tag.technology);
        if (has_uid(tag.technology)) {
            if (!epc.empty() && epc.size() != uid_size)
                wrong("epc",
                      fmt::format("{} bytes; the UID of an {} tag has {}", epc.size(), technology, uid_size));
        } else if (epc.size() > event::TagId::max_size) {
            wrong("epc", fmt::format("{} bytes; a tag can hold {} at most", epc.size(),
                                     std::size_t{event::TagId::max_size}));
        }
        if (tag.technology == Technology::iso18000_6b && tag.user.size() > most_user_6b)
            wrong("user", fmt::format("{} bytes; after the UID an {} tag has {} at most", tag.user.size(),
                                      technology, most_user_6b));
        if (tag.technology == Technology::epc_gen1 && tag.kill_password > 0xFFFF)
            wrong("kill_password", fmt::format("the kill code of an {} tag has 16 bits; write 0000 and "
                                               "then its 4 hex digits",
                                               technology));
        if (tag.technology != Technology::epc_gen2) {
            if (tag.xpc) wrong("xpc", fmt::format("an {} tag has none; only epc-gen2 tags do", technology));
            return;
        }
        auto words = [&](std::string_view column, const Bytes& bytes) {
            if (bytes.size() % 2 != 0)
                wrong(column, fmt::format("{} bytes; the memory of an {} tag comes in words of two",
                                          bytes.size(), technology));
        };
        words("epc", epc);
        words("tid", tag.tid);
        words("user", tag.user);
    }

    static bool has_uid(event::Technology technology) {
        using event::Technology;
        return technology == Technology::iso15693 || technology == Technology::icode1 ||
               technology == Technology::iso18000_6b;
    }
    event::TagId made_id(event::Technology technology) const {
        if (!has_uid(technology)) return sgtin96(812'345, static_cast<std::uint64_t>(line_));
        // As ISO/IEC 15693 and 18000-6 have it: E0h, then the maker's code (04h: NXP, who makes all three),
        // then the serial number.
        Bytes uid{0xE0, 0x04, 0x01, 0x00};
        for (int shift = 24; shift >= 0; shift -= 8)
            uid.push_back(static_cast<std::uint8_t>(line_ >> shift));
        return event::TagId(uid);
    }

    Bytes hex(std::string_view column, std::string_view text) {
        if (auto bytes = from_hex(text)) return *bytes;
        wrong(column, fmt::format("\"{}\" is not hex; write two digits for each byte", printable(text)));
        return {};
    }
    std::uint32_t password(std::string_view column, std::string_view text) {
        auto bytes = from_hex(text);
        if (!bytes || bytes->size() != 4) {
            wrong(column, "a password is 8 hex digits");  // and is not shown
            return 0;
        }
        std::uint32_t value = 0;
        for (auto byte : *bytes)
            value = value << 8 | byte;
        return value;
    }
    std::uint16_t xpc(std::string_view column, std::string_view text) {
        auto bytes = from_hex(text);
        if (bytes && bytes->size() == 2) return static_cast<std::uint16_t>((*bytes)[0] << 8 | (*bytes)[1]);
        wrong(column, fmt::format("\"{}\" is no XPC_W1; it has 4 hex digits", printable(text)));
        return 0;
    }
    event::Technology technology(std::string_view column, std::string_view text) {
        if (auto known = event::parse_technology(text)) return *known;
        std::string names;
        for (auto& each : event::all_technologies())
            names += (names.empty() ? "" : ", ") + std::string(each.name);
        wrong(column, fmt::format("\"{}\" is no technology; known are {}", printable(text), names));
        return {};
    }
    std::uint16_t antenna(std::string_view column, std::string_view text) {
        std::uint16_t value = 0;
        auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc{} || end != text.data() + text.size() || value == 0)
            wrong(column, fmt::format("\"{}\" is no antenna; they count from 1", printable(text)));
        return value;
    }
    double rssi(std::string_view column, std::string_view text) {
        double value = 0;
        auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc{} || end != text.data() + text.size() || !(value >= -120 && value <= 20))
            wrong(column, fmt::format("\"{}\" is no strength in dBm from -120 to 20", printable(text)));
        return value;
    }

    std::string name_;
    std::size_t line_ = 0;
    std::vector<std::string> header_;
    bool header_refused_ = false;
    std::size_t error_count_ = 0;
    std::string errors_;
    std::vector<PlacedTag> tags_;
    std::map<std::string, std::size_t> lines_;  // id in hex, and where it was
};

}  // namespace

Result<std::vector<PlacedTag>> read_tags_csv(std::string_view text, std::string_view file_name) {
    if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);  // spreadsheets put this mark of UTF-8 there
    TagsFile file(file_name);
    while (!text.empty() && !file.given_up()) {
        auto end = std::min(text.find('\n'), text.size());
        file.line(text.substr(0, end));
        text.remove_prefix(std::min(end + 1, text.size()));
    }
    return std::move(file).finish();
}

}  // namespace gantry::field
