#include "api/json_text.hpp"

#include <gtest/gtest.h>
#include <boost/json.hpp>

namespace gantry::api {
namespace {

TEST(JsonText, NumbersAreWrittenAsPeopleWriteThem) {
    EXPECT_EQ(json_text(-48.6), "-48.6");
    EXPECT_EQ(json_text(0.1), "0.1");
    EXPECT_EQ(json_text(-50.0), "-50.0");
    EXPECT_EQ(json_text(1e300), "1e+300");
    EXPECT_EQ(json_text(18446744073709551615u), "18446744073709551615");
    EXPECT_EQ(json_text(-7), "-7");
}

TEST(JsonText, EverythingElseIsAsTheLibraryWritesIt) {
    auto value = boost::json::parse(
        R"({"a":[1,2,{"b":null}],"c":"q\"\\\u0001\u20ac","d":true,"":[],"e":{},"f\n":false})");
    EXPECT_EQ(json_text(value), boost::json::serialize(value));
}

TEST(JsonText, WhatIsWrittenComesBack) {
    boost::json::value value = {{"x", {1.5, -3.0, 2.5e-7, 1e22, 7}}, {"y", "z"}};
    EXPECT_EQ(boost::json::parse(json_text(value)), value);
}

}  // namespace
}  // namespace gantry::api
