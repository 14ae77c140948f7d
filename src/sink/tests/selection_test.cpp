#include "sink/selection.hpp"

#include <gtest/gtest.h>

#include "base/bytes.hpp"

namespace gantry::sink {
namespace {

event::Event at_dock() {
    event::Event event;
    event.type = event::Type::tag_observed;
    event.reader = "dock-1";
    event.zone = "dock/left";
    event.tag = event::TagId(from_hex("3074257BF7194E4000001A85").value());
    event.epc = "urn:epc:id:sgtin:0614141.812345.6789";
    return event;
}

TEST(Selection, AnEmptyOneTakesAll) {
    EXPECT_TRUE(Selection{}.everything());
    EXPECT_TRUE(Selection{}.takes(at_dock()));
    EXPECT_TRUE(Selection{}.takes({}));
}

TEST(Selection, EachListRestricts) {
    struct Case {
        Selection selection;
        bool takes;
    };
    for (auto& each : std::initializer_list<Case>{
             {{.types = {event::Type::tag_new, event::Type::tag_observed}}, true},
             {{.types = {event::Type::tag_new}}, false},
             {{.readers = {"gate", "dock-*"}}, true},
             {{.readers = {"dock"}}, false},
             {{.zones = {"dock/*"}}, true},
             {{.zones = {"dock"}}, false},
             {{.tags = {"3074*"}}, true},
             {{.tags = {"3075*"}}, false},
             {{.tags = {"urn:epc:id:sgtin:0614141.*"}}, true},
             {{.tags = {"urn:epc:id:sscc:*"}}, false},
             {{.types = {event::Type::tag_observed}, .readers = {"gate"}}, false},
         }) {
        EXPECT_FALSE(each.selection.everything());
        EXPECT_EQ(each.selection.takes(at_dock()), each.takes);
    }
}

TEST(Selection, EventsThatSayNothingOfIt) {
    event::Event fault;
    fault.type = event::Type::reader_fault;
    fault.reader = "dock-1";
    EXPECT_TRUE((Selection{.tags = {"3074*"}}.takes(fault))) << "it is about no tag";
    EXPECT_FALSE((Selection{.zones = {"*"}}.takes(fault))) << "it is in no zone";
    event::Event overflow;
    overflow.type = event::Type::overflow;
    EXPECT_FALSE((Selection{.readers = {"*"}}.takes(overflow))) << "it is of no reader";
}

TEST(Selection, AMoveConcernsBothZones) {
    auto move = at_dock();
    move.type = event::Type::tag_moved;
    move.from = "yard";
    move.to = move.zone;
    EXPECT_TRUE((Selection{.zones = {"yard"}}.takes(move)));
    EXPECT_TRUE((Selection{.zones = {"dock/left"}}.takes(move)));
    EXPECT_FALSE((Selection{.zones = {"shop"}}.takes(move)));
}

}  // namespace
}  // namespace gantry::sink
