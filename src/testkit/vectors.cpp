#include "testkit/vectors.hpp"

#include <fstream>
#include <sstream>
#include <stdexcept>

#include <gtest/gtest.h>

namespace gantry::testkit {

std::vector<Vector> read_vectors(std::string_view path) {
    std::ifstream file{std::string(path)};
    if (!file) {
        ADD_FAILURE() << "cannot read " << path;
        return {};
    }
    std::vector<Vector> vectors;
    std::string line;
    while (std::getline(file, line)) {
        if (line.empty() || line.front() == '#' || line.starts_with("id\t")) continue;
        std::vector<std::string> columns;
        std::istringstream row(line);
        for (std::string column; std::getline(row, column, '\t');)
            columns.push_back(column);
        auto bytes = columns.size() >= 3 ? from_hex(columns[2]) : std::nullopt;
        if (columns.size() < 4 || !bytes) {
            ADD_FAILURE() << path << ": bad row: " << line;
            continue;
        }
        vectors.push_back({columns[0], columns[1], columns[3], columns.size() > 4 ? columns[4] : "", *bytes});
    }
    return vectors;
}

void for_each_split(ByteView in, const std::function<void(const std::vector<ByteView>&)>& check) {
    check({in});
    std::vector<ByteView> single;
    for (std::size_t i = 0; i < in.size(); ++i)
        single.push_back(in.subspan(i, 1));
    check(single);
    for (std::size_t i = 1; i < in.size(); ++i)
        check({in.first(i), in.subspan(i)});
}

Bytes hex(std::string_view text) {
    auto bytes = from_hex(text);
    if (!bytes) throw std::invalid_argument("not hex: " + std::string(text));
    return *bytes;
}

}  // namespace gantry::testkit
