#pragma once
#include <string_view>

namespace gantry::sinks::kafka {

// Is an error, by its name, about the message, so that it is never taken? Else it is about the cluster, the
// connection or the topic, and the message is as good as any.
bool blames_the_message(std::string_view error);

}  // namespace gantry::sinks::kafka
