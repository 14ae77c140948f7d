#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "http/message.hpp"

namespace gantry::http {
namespace {

RC_GTEST_PROP(Targets, WhatIsEncodedIsDecodedAgain, (std::string path, std::string key, std::string value)) {
    auto clean = [](std::string& text) { std::erase(text, '\0'); };
    clean(path);
    clean(key);
    clean(value);
    RC_PRE(!key.empty());
    auto target = parse_target("/" + encode_component(path) + "?" + encode_component(key) + "=" +
                               encode_component(value) + "&last=");
    RC_ASSERT(target.has_value());
    RC_ASSERT(target->path == "/" + path);
    RC_ASSERT(target->query.size() == 2u);
    RC_ASSERT(target->query[0].first == key);
    RC_ASSERT(target->query[0].second == value);
}

RC_GTEST_PROP(Targets, AnyTextIsReadOrRefused, (const std::string& text)) {
    auto target = parse_target(text);
    if (target) {
        RC_ASSERT(target->path.starts_with('/'));
        RC_ASSERT(target->path.find('\0') == std::string::npos);
    }
}

}  // namespace
}  // namespace gantry::http
