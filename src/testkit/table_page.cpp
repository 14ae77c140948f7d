#include "testkit/table_page.hpp"

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string_view>

#include <gtest/gtest.h>

namespace gantry::testkit {

namespace {
// The page with its tables made anew; `seen` counts them.
std::string made_anew(const std::string& text, const PageTables& tables,
                      std::map<std::string, unsigned>& seen) {
    std::string made, line;
    std::istringstream in(text);
    bool inside = false;
    while (std::getline(in, line)) {
        if (line == "<!-- end -->") inside = false;
        if (!inside) made += line + "\n";
        constexpr std::string_view begin = "<!-- table ", end = " -->";
        if (!line.starts_with(begin)) continue;
        auto name = line.substr(begin.size(), line.size() - begin.size() - end.size());
        ++seen[name];
        auto table = tables.find(name);
        if (table == tables.end()) {
            ADD_FAILURE() << "no table " << name;
            continue;
        }
        made += "\n" + table->second() + "\n";
        inside = true;
    }
    EXPECT_FALSE(inside) << "a table without its end";
    return made;
}
}  // namespace

void check_table_page(const std::string& page, const PageTables& tables) {
    std::ifstream file(page);
    ASSERT_TRUE(file) << page;
    std::string text{std::istreambuf_iterator<char>(file), {}};
    std::map<std::string, unsigned> seen;
    auto made = made_anew(text, tables, seen);
    for (auto& [name, table] : tables)
        EXPECT_EQ(seen[name], 1u) << name;
    if (std::getenv("GANTRY_WRITE_DOCS") != nullptr) {
        std::ofstream(page) << made;
        return;
    }
    EXPECT_TRUE(made == text) << page << " is not what the tables say. Write it anew: run this test with\n"
                              << "GANTRY_WRITE_DOCS=1 in its environment";
}

}  // namespace gantry::testkit
