#include "cli/demo_scene.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "link/serial.hpp"
#include "protocols/registry.hpp"
#include "wire/layout.hpp"

namespace gantry::cli {

namespace {
// The sections that the demo's gateway runs on, and the settings of the virtual reader of each. PLACE is
// where a reader listens, or its serial line.
struct Role {
    std::string_view name, make, toml, zone;
    std::vector<std::pair<std::string, std::string>> device;
    bool moving;
};
const std::vector<Role>& roles() {
    static const std::vector<Role> all = {
        {"dock",
         "silion",
         R"(
[[reader]]
name = "dock"
address = "silion-listen://127.0.0.1:0"
zone = "dock"
)",
         "dock",
         {{"generation", "2"}, {"batch", "300ms"}},
         true},
        {"conveyor",
         "silion",
         R"(
[[reader]]
name = "conveyor"
address = "silion-listen://127.0.0.1:0"
zone = "conveyor"
[[reader.antenna]]
name = "Ant1"
zone = "conveyor/in"
[[reader.antenna]]
name = "Ant2"
zone = "conveyor/out"
)",
         "conveyor",
         {{"generation", "1"}, {"batch", "300ms"}},
         true},
        {"shelf",
         "silion",
         R"(
[[reader]]
name = "shelf"
address = "silion-listen://127.0.0.1:0"
zone = "shelf"
)",
         "shelf",
         {{"generation", "2"}, {"batch", "500ms"}},
         false},
        {"portal",
         "caen",
         R"(
[[reader]]
name = "portal"
address = "caen://PLACE"
zone = "portal"
)",
         "portal",
         {{"round", "100ms"}},
         true},
        {"counter",
         "caen",
         R"(
[[reader]]
name = "counter"
address = "caen://PLACE"
zone = "counter"
poll = "500ms"
)",
         "counter",
         {{"model", "R4300P"}},
         false},
        {"gate",
         "harting",
         R"(
[[reader]]
name = "gate"
address = "harting://PLACE"
zone = "gate"
)",
         "gate",
         {},
         true},
        {"desk",
         "dagprog",
         R"(
[[reader]]
name = "desk"
address = "dagprog://PLACE"
zone = "desk"
)",
         "desk",
         {},
         true},
    };
    return all;
}

std::uint64_t number(const wire::Fields& fields, std::string_view name) {
    const auto* value = wire::find(fields, name);
    return value == nullptr ? 0 : static_cast<std::uint64_t>(wire::as_number(*value).value_or(0));
}
}  // namespace

std::uint64_t reads_sent(const wire::Fields& state) {
    return number(state, wire::find(state, "reads_sent") != nullptr ? "reads_sent" : "tags_sent");
}

DemoScene::~DemoScene() {
    readers_.clear();
    gateway_.reset();
}

std::string DemoScene::configuration() const {
    std::string toml =
        "[gateway]\nid = \"demo\"\n[presence]\nlose_after = \"1500ms\"\n[events]\ntag_read = true\n";
    for (auto& role : roles()) {
        std::string section(role.toml);
        auto reader = std::ranges::find(readers_, role.name, &DemoReader::name);
        constexpr std::string_view place = "PLACE";
        if (auto at = section.find(place); at != std::string::npos && reader != readers_.end())
            section.replace(at, place.size(), reader->place);
        toml += section;
    }
    return toml;
}

Result<std::unique_ptr<DemoScene>> DemoScene::start(const std::filesystem::path& directory) {
    std::unique_ptr<DemoScene> scene(new DemoScene);
    scene->started_ = link::read_clocks();
    scene->next_chapter_ = scene->started_.steady + 4s;
    scene->loop_ = std::make_unique<link::Loop>("demo-readers");
    std::error_code error;
    std::filesystem::create_directories(directory, error);  // what is wrong with it the store will say
    if (auto added = scene->add_readers(false, directory); !added) return tl::unexpected(added.error());
    auto config = gateway::parse_config(scene->configuration(), "demo");
    if (!config) return tl::unexpected(config.error());
    config->data_dir = directory;
    if (std::filesystem::exists(directory / "gantry.db", error)) {
        auto before = journal::Reader::open(directory / "gantry.db");
        auto last = before ? (*before)->last_seq() : tl::unexpected(before.error());
        if (!last) return tl::unexpected(last.error().error);
        scene->begins_after_ = *last;
    }
    auto gateway = gateway::Gateway::start(std::move(*config));
    if (!gateway) return tl::unexpected(gateway.error());
    scene->gateway_ = std::move(*gateway);
    if (auto added = scene->add_readers(true, directory); !added) return tl::unexpected(added.error());
    return scene;
}

Result<void> DemoScene::add_readers(bool dials, const std::filesystem::path& directory) {
    std::size_t dialled = 0;
    for (std::size_t i = 0; i < roles().size(); ++i) {
        auto& role = roles()[i];
        const auto& plugin = *find_plugin(role.make);
        if (plugin.device_dials != dials) continue;
        auto settings = Settings::make(plugin.device_settings, role.device);
        if (!settings) return tl::unexpected(settings.error());
        auto kind =
            plugin.device_tags != nullptr ? plugin.device_tags(*settings) : event::Technology::epc_gen2;
        bool hf = kind == event::Technology::iso15693 || kind == event::Technology::icode1;
        auto& air = field_.add_reader(role.name, hf ? 1 : 2);
        if (role.moving) {
            field::TrafficSpec traffic;
            traffic.seed = 7 + i;
            traffic.tags = 10;
            traffic.stay_min = 1500ms;
            traffic.stay_max = 5s;
            traffic.away_min = 2s;
            traffic.away_max = 6s;
            if (hf) {  // one chip after another: these units read one at a time
                traffic.tags = 3;
                traffic.pool = field::hf_tags(kind, traffic.seed, traffic.tags);
            }
            field_.add_traffic(air, traffic, started_.steady);
        } else {
            for (auto& tag : field::default_tags(static_cast<std::uint32_t>(i)))
                field_.place(air, tag);
        }
        DeviceOptions options;
        options.name = role.name;
        options.seed = i + 1;
        options.settings = *settings;
        DemoReader reader{std::string(role.name), std::string(role.make), {}, dials, nullptr};
        auto device = plugin.make_device(options, air);
        if (dials) {
            // The gateway listens for these in the order of its sections.
            auto place = gateway_->listeners()[dialled++].local;
            reader.host = link::DeviceHost::dial(*loop_, std::move(device), place);
        } else if (auto& scheme = plugin.schemes.front(); scheme.kind == LinkKind::serial) {
            reader.place = (directory / fmt::format("{}.line", role.name)).string();
            auto host =
                link::DeviceHost::pty(*loop_, std::move(device), reader.place, link::baud_of(scheme.line));
            if (!host) return tl::unexpected(host.error());
            reader.host = std::move(*host);
        } else {
            auto host = link::DeviceHost::listen(*loop_, std::move(device), {"127.0.0.1", 0});
            if (!host) return tl::unexpected(host.error());
            reader.host = std::move(*host);
            reader.place = link::to_text(reader.host->local());
        }
        readers_.push_back(std::move(reader));
    }
    return {};
}

std::string DemoScene::tell_story() {
    auto now = link::read_clocks();
    if (now.steady < next_chapter_) return {};
    // Every third chapter a cable; between them a hand at the device, of one that tells of it unasked.
    auto turn = chapter_ / 3;
    auto* chosen = &readers_[turn % readers_.size()];
    if (chapter_ % 3 != 0)
        while (!chosen->dials)
            chosen = &readers_[++turn % readers_.size()];
    auto& reader = *chosen;
    auto since =
        approximate(std::chrono::duration_cast<std::chrono::microseconds>(now.steady - started_.steady));
    switch (chapter_++ % 3) {
        case 0:
            reader.host->cut();
            next_chapter_ = now.steady + 5s;
            return fmt::format(
                "* {}: the cable of {} is pulled; {}", since, reader.name,
                reader.dials ? "it keeps its reads and dials again" : "the gateway dials it again");
        case 1:
            reader.host->with_device([](Device& device, Now at) { (void)device.inject("input 1=1", at); });
            next_chapter_ = now.steady + 3s;
            return fmt::format("* {}: somebody steps into the light barrier at input 1 of {}", since,
                               reader.name);
        default:
            reader.host->with_device([](Device& device, Now at) { (void)device.inject("input 1=0", at); });
            next_chapter_ = now.steady + 6s;
            return fmt::format("* {}: and out of it again", since);
    }
}

DemoBooks DemoScene::end() {
    DemoBooks books;
    books.readers = readers_.size();
    books.lasted =
        std::chrono::duration_cast<std::chrono::microseconds>(link::read_clocks().steady - started_.steady);
    std::map<std::string, std::uint64_t> acknowledged, stored;
    std::map<std::string, std::string> make_of;
    for (auto& reader : readers_) {
        reader.host->cut();  // what it sends after it was counted would be stored
        reader.host->with_device([&](Device& device, Now) {
            auto state = device.state();
            auto& reads = books.makes[reader.make];
            reads.sent += reads_sent(state);
            if (wire::find(state, "reads_acked") == nullptr) return;
            acknowledged[reader.name] = number(state, "reads_acked");
            reads.acknowledged = reads.acknowledged.value_or(0) + acknowledged[reader.name];
        });
        make_of[reader.name] = reader.make;
    }
    readers_.clear();
    gateway_->stop();
    auto store = journal::Reader::open(gateway_->config().data_dir / "gantry.db");
    if (!store) return books;
    journal::Filter this_run;
    this_run.after = begins_after_;
    (void)(*store)->query(this_run, [&](const event::Event& event) {
        ++books.events[std::string(event::to_text(event.type))];
        if (event.type == event::Type::tag_read) stored[event.reader] += event.reads;
        return true;
    });
    for (auto& [name, count] : stored)
        books.makes[make_of[name]].stored += count;
    for (auto& [name, count] : acknowledged)
        if (count > stored[name]) books.lost += count - stored[name];
    return books;
}

}  // namespace gantry::cli
