#include "sinks/jsonl/file_names.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <optional>
#include <system_error>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::jsonl {

static constexpr std::string_view plain_end = ".jsonl", gzip_end = ".jsonl.gz",
                                  unfinished_end = ".jsonl.gz.tmp";

static std::string_view ending(Form form) {
    return form == Form::plain ? plain_end : form == Form::gzipped ? gzip_end : unfinished_end;
}

std::string stem_of(std::string_view sink_name) {
    std::string out;
    for (char c : sink_name) {
        bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                     c == '_' || (c == '.' && !out.empty());
        if (plain)
            out += c;
        else
            out += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
    return out;
}

std::string file_name(std::string_view stem, std::uint64_t number, Form form) {
    return fmt::format("{}-{:08}{}", stem, number, ending(form));
}

static std::optional<Found> parse_name(std::string_view name, std::string_view stem) {
    if (!name.starts_with(stem)) return {};
    auto rest = name.substr(stem.size());
    if (!rest.starts_with('-')) return {};
    rest.remove_prefix(1);
    Found found;
    auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), found.number);
    if (error != std::errc{}) return {};
    for (auto form : {Form::plain, Form::gzipped, Form::unfinished}) {
        found.form = form;
        if (name == file_name(stem, found.number, form)) return found;
    }
    return {};
}

Result<std::vector<Found>> find_files(const std::string& dir, std::string_view stem) {
    std::vector<Found> out;
    std::error_code error;
    std::filesystem::directory_iterator each(dir, error);
    for (; !error && each != std::filesystem::directory_iterator(); each.increment(error))
        if (auto found = parse_name(each->path().filename().native(), stem)) out.push_back(*found);
    if (error) return tl::unexpected(system_error("cannot look into", dir, error.value()));
    std::ranges::sort(out);
    return out;
}

Error system_error(std::string_view did, const std::string& path, int number) {
    std::string hint;
    if (number == ENOENT || number == ENOTDIR)
        hint = "it must be there before anything is written: is it mounted?";
    if (number == EACCES || number == EPERM) hint = "this user must be allowed to write there";
    if (number == ENOSPC || number == EDQUOT) hint = "make room; it goes on by itself";
    return {fmt::format("{} {}: {}", did, printable(path), std::generic_category().message(number)), hint};
}

}  // namespace gantry::sinks::jsonl
