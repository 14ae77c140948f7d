#include "testkit/table_page.hpp"

#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

#include "testkit/process.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::testkit {

static const PageTables tables = {{"codes", [] { return std::string("| 1 | one |\n"); }}};
static std::string page;

static void write_page(const TempDir& dir, const std::string& text) {
    page = dir.path() + "/page.md";
    write_file(page, text);
}

TEST(TablePage, WhatTheTablesSayPasses) {
    TempDir dir;
    write_page(dir, "by hand\n<!-- table codes -->\n\n| 1 | one |\n\n<!-- end -->\nby hand\n");
    check_table_page(page, tables);
}

TEST(TablePage, AStaleTableFails) {
    TempDir dir;
    write_page(dir, "<!-- table codes -->\n\n| 1 | uno |\n\n<!-- end -->\n");
    EXPECT_NONFATAL_FAILURE(check_table_page(page, tables), "is not what the tables say");
}

TEST(TablePage, ATableThatIsMissingFails) {
    TempDir dir;
    write_page(dir, "by hand\n");
    EXPECT_NONFATAL_FAILURE(check_table_page(page, tables), "codes");
}

TEST(TablePage, ATableThatNobodyMakesFails) {
    TempDir dir;
    write_page(dir, "<!-- table names -->\n<!-- table codes -->\n\n| 1 | one |\n\n<!-- end -->\n");
    EXPECT_NONFATAL_FAILURE(check_table_page(page, tables), "no table names");
}

}  // namespace gantry::testkit
