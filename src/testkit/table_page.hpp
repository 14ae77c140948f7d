#pragma once
#include <functional>
#include <map>
#include <string>

namespace gantry::testkit {

// A page of docs/ that is written by hand but for its tables, which stand between <!-- table NAME --> and
// <!-- end -->. Fails the test unless it has each of `tables` once, and each says what the code's table says.
// With GANTRY_WRITE_DOCS in the environment the page is written.
using PageTables = std::map<std::string, std::function<std::string()>>;
void check_table_page(const std::string& page, const PageTables& tables);

}  // namespace gantry::testkit
