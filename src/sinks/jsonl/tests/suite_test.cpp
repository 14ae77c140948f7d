#include "jsonl_testing.hpp"

namespace gantry::sinks::jsonl {
namespace {

// A directory; killed is moved away, as an unmounted disk is.
class DirectoryDestination : public testkit::Destination {
public:
    void start() override {
        if (std::filesystem::exists(away_))
            std::filesystem::rename(away_, dir_);
        else
            std::filesystem::create_directory(dir_);
    }
    void kill() override { std::filesystem::rename(dir_, away_); }
    std::unique_ptr<sink::Sink> make_sink() override { return make_jsonl(dir_, {{"rotate_size", "50KiB"}}); }
    std::vector<std::string> ids() override { return ids_in(dir_); }

private:
    testkit::TempDir temp_;
    const std::string dir_ = temp_.path() + "/events", away_ = temp_.path() + "/away";
};

GANTRY_SINK_SUITE(Jsonl, DirectoryDestination)

}  // namespace
}  // namespace gantry::sinks::jsonl
