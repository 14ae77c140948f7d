#include "cli/demo_scene.hpp"

#include <gtest/gtest.h>

namespace gantry::cli {
namespace {

TEST(DemoBooks, CountReadsOnceWhetherOrNotAMakeTellsThemFromItsTagRecords) {
    wire::Fields both, tags, reads;
    for (auto* fields : {&both, &tags})
        fields->push_back({"tags_sent", wire::Value(7)});
    for (auto* fields : {&both, &reads})
        fields->push_back({"reads_sent", wire::Value(9)});
    EXPECT_EQ(reads_sent(both), 9u);
    EXPECT_EQ(reads_sent(reads), 9u);
    EXPECT_EQ(reads_sent(tags), 7u);
    EXPECT_EQ(reads_sent({}), 0u);
}

}  // namespace
}  // namespace gantry::cli
