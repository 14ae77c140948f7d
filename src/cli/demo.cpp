// gantry demo: the main job with no hardware. Virtual readers dial a gateway over real TCP; tags come and go;
// a cable is pulled now and then; at the end the books must balance.
#include <cstdlib>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/api.hpp"
#include "base/log.hpp"
#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/demo_scene.hpp"
#include "cli/event_text.hpp"
#include "cli/screen.hpp"
#include "cli/signals.hpp"
#include "cli/values.hpp"
#include "journal/journal.hpp"

namespace gantry::cli {

namespace {
struct DemoOptions {
    std::optional<std::chrono::milliseconds> run_for;
    std::string dir;
    bool headless = false;
};

// The data directory: the user's, or one of our own that goes with us.
class DemoDirectory {
public:
    explicit DemoDirectory(const std::string& wanted) {
        if (!wanted.empty()) {
            path_ = wanted;
            return;
        }
        std::string pattern = (std::filesystem::temp_directory_path() / "gantry-demo-XXXXXX").string();
        if (mkdtemp(pattern.data()) != nullptr) path_ = pattern;
        own_ = true;
    }
    ~DemoDirectory() {
        std::error_code error;
        if (own_ && !path_.empty()) std::filesystem::remove_all(path_, error);
    }
    DemoDirectory(const DemoDirectory&) = delete;
    DemoDirectory& operator=(const DemoDirectory&) = delete;
    const std::filesystem::path& path() const { return path_; }
    bool own() const { return own_; }

private:
    std::filesystem::path path_;
    bool own_ = false;
};

// What is shown while it runs: a table in a terminal, plain lines elsewhere.
class DemoView {
public:
    DemoView(Context& context, DemoScene& scene, journal::Reader& store)
        : context_(context), scene_(scene), store_(store) {
        seen_ = scene.begins_after();
        if (Screen::possible()) screen_ = std::make_unique<Screen>();
    }

    void update(const std::string& story) {
        if (!story.empty()) lately_.push_back(story);
        auto logged = capture_.take();
        for (std::string_view lines = logged; !lines.empty();) {
            auto line = lines.substr(0, lines.find('\n'));
            lines.remove_prefix(std::min(lines.size(), line.size() + 1));
            lately_.emplace_back(line);
        }
        if (screen_)
            draw();
        else
            print_events();
    }
    bool takes_keys() const { return screen_ && screen_->takes_keys(); }

private:
    void print_events() {
        for (auto& line : lately_)
            context_.out << line << '\n';
        lately_.clear();
        journal::Filter filter;
        filter.after = seen_;
        using event::Type;
        filter.types = {Type::tag_new,
                        Type::tag_observed,
                        Type::tag_lost,
                        Type::tag_purged,
                        Type::tag_moved,
                        Type::reader_connected,
                        Type::reader_disconnected,
                        Type::reader_fault,
                        Type::gpi_changed};
        (void)store_.query(filter, [&](const event::Event& event) {
            seen_ = event.seq;
            context_.out << for_people(event) << '\n';
            return true;
        });
        context_.out << std::flush;
    }

    void draw();
    void draw_readers(std::vector<std::string>& lines);
    void draw_tags(std::vector<std::string>& lines, std::vector<journal::PresentTag> tags, Screen::Size size);

    Context& context_;
    DemoScene& scene_;
    journal::Reader& store_;
    log::Capture capture_;  // a log line must not tear the table
    std::unique_ptr<Screen> screen_;
    std::vector<std::string> lately_;
    journal::Seq seen_ = 0;
    std::map<std::string, std::uint64_t> reads_before_;
    Steady drawn_{};
};

void DemoView::draw_readers(std::vector<std::string>& lines) {
    auto now = link::read_clocks();
    auto seconds = std::chrono::duration<double>(now.steady - drawn_).count();
    lines.push_back(fmt::format("{:<12} {:<9} {:>8}  {}", "READER", "MAKE", "READS/S", "STATE"));
    for (auto& reader : scene_.gateway().readers()) {
        auto& before = reads_before_[reader.name];
        auto rate = drawn_ == Steady{} ? 0.0 : static_cast<double>(reader.reads - before) / seconds;
        before = reader.reads;
        lines.push_back(
            fmt::format("{:<12} {:<9} {:>8.0f}  {}", reader.name, reader.make, rate, reader.state));
    }
    drawn_ = now.steady;
}

// `size`: how many tags there is room for, and how wide a line is.
void DemoView::draw_tags(std::vector<std::string>& lines, std::vector<journal::PresentTag> tags,
                         Screen::Size size) {
    std::ranges::sort(tags, std::greater{}, &journal::PresentTag::first_seen);
    // All of it fits into 80 columns, without what every EPC begins with; more columns go to the names.
    constexpr std::string_view every_epc = "urn:epc:id:";
    constexpr std::size_t others = 42, zone_width = 12, shortest_name = 20, longest_name = 44;
    auto name_width =
        std::clamp(size.columns > others ? size.columns - others : 0, shortest_name, longest_name);
    auto row = [&](std::string_view name, std::string_view zone, std::string_view rssi,
                   std::string_view reads, std::string_view since) {
        lines.push_back(fmt::format("{:<{}} {:<{}} {:>8} {:>6}  {}", fit(name, name_width), name_width,
                                    fit(zone, zone_width), zone_width, rssi, reads, since));
    };
    row(fmt::format("TAGS PRESENT: {}", tags.size()), "ZONE", "RSSI", "READS", "SINCE");
    auto now = link::read_clocks().wall;
    for (auto& tag : tags) {
        if (size.rows-- == 0) break;
        auto name = tag.epc.empty() ? to_hex(tag.tag.view()) : tag.epc;
        if (name.starts_with(every_epc)) name.erase(0, every_epc.size());
        auto rssi = tag.rssi ? fmt::format("{:.0f} dBm", *tag.rssi / 10.0) : std::string("-");
        row(name, printable(tag.zone), rssi, fmt::format("{}", tag.reads), approximate(now - tag.first_seen));
    }
}

void DemoView::draw() {
    auto [rows, columns] = Screen::size();
    auto stats = scene_.gateway().stats();
    std::vector<journal::PresentTag> tags;
    (void)store_.present_tags([&](const journal::PresentTag& tag) {
        tags.push_back(tag);
        return true;
    });
    std::vector<std::string> lines;
    std::vector<std::size_t> bold{0};
    lines.push_back(fmt::format("Gantry demo: {} virtual readers, {} events stored safely, {} tags present",
                                scene_.size(), stats.last_seq - scene_.begins_after(), tags.size()));
    lines.push_back(
        fmt::format("{}Ctrl-C ends it. Look into the store meanwhile:", takes_keys() ? "q or " : ""));
    lines.push_back("  gantry events tail --data-dir " + scene_.directory().string());
    lines.emplace_back();
    bold.push_back(lines.size());
    draw_readers(lines);
    lines.emplace_back();
    constexpr std::size_t lately_rows = 5;
    auto room = rows > lines.size() + lately_rows + 3 ? rows - lines.size() - lately_rows - 3 : 0;
    bold.push_back(lines.size());
    draw_tags(lines, std::move(tags), {room, columns});
    lines.resize(std::max(lines.size(), rows > lately_rows + 1 ? rows - lately_rows - 1 : 0));
    bold.push_back(lines.size());
    lines.emplace_back("LATELY");
    if (lately_.size() > lately_rows) lately_.erase(lately_.begin(), lately_.end() - lately_rows);
    lines.insert(lines.end(), lately_.begin(), lately_.end());
    screen_->draw(lines, bold);
}

int summary(Context& context, const DemoBooks& books, const std::filesystem::path& store, bool goes) {
    std::uint64_t sent = 0, stored = 0;
    for (auto& [make, reads] : books.makes) {
        sent += reads.sent;
        stored += reads.stored;
    }
    context.out << fmt::format("{} virtual readers sent {} tag reads in {}; the store holds {} of them\n",
                               books.readers, sent, approximate(books.lasted), stored);
    for (auto& [make, reads] : books.makes)
        context.out << fmt::format("  {}: {} sent, {} stored, {}\n", make, reads.sent, reads.stored,
                                   reads.acknowledged
                                       ? fmt::format("{} acknowledged", *reads.acknowledged)
                                       : "none acknowledged: this protocol has no acknowledgement");
    std::uint64_t events = 0;
    for (auto& [type, count] : books.events)
        events += count;
    std::string line;
    for (auto& [type, count] : books.events)
        line +=
            fmt::format("{}{} {}", line.empty() ? fmt::format("events: {}; ", events) : ", ", type, count);
    context.out << line << '\n';
    if (books.lost > 0) {
        context.out << fmt::format("LOST: {} acknowledged reads are not in the store\n", books.lost);
        return failed;
    }
    context.out << "lost: 0; every acknowledged read is in the store\n";
    if (!goes)
        context.out << fmt::format("the store is {}; try: sqlite3 {} 'select * from present_tags'\n",
                                   store.string(), store.string());
    return done;
}

// Until the time is over or somebody ends it. Without a view the story goes to the log.
void play(Context& context, const DemoOptions& options, Signals& signals, DemoScene& scene, DemoView* view) {
    auto is_end = [](std::string_view keys) { return keys.find_first_of("qQ") != std::string_view::npos; };
    auto left = options.run_for;
    constexpr std::chrono::milliseconds frame = 500ms;
    for (bool end = false; !end;) {
        auto pause = left ? std::min(frame, *left) : frame;
        end = view != nullptr && view->takes_keys() ? signals.wait(pause, is_end) : signals.wait(pause);
        if (left) *left -= pause;
        if (left && left->count() <= 0) end = true;
        auto story = scene.tell_story();
        if (view != nullptr)
            view->update(story);
        else if (!story.empty())
            log::info("demo", "{}", story);
        if (nobody_reads(context)) end = true;
    }
}

int demo(Context& context, const DemoOptions& options) {
    Signals signals;
    DemoDirectory directory(options.dir);
    auto scene = DemoScene::start(directory.path());
    if (!scene) return complain(context, "demo", scene.error());
    auto api = api::Api::start((*scene)->gateway());
    if (!api) return complain(context, "demo", api.error());
    auto store = journal::Reader::open(directory.path() / "gantry.db");
    if (!store) return complain(context, "demo", store.error().error);
    if (options.headless) {
        play(context, options, signals, **scene, nullptr);
    } else {
        context.out << fmt::format("{} virtual readers and a gateway, joined by loopback; events go to {}\n",
                                   (*scene)->size(), (directory.path() / "gantry.db").string())
                    << std::flush;
        DemoView view(context, **scene, **store);
        play(context, options, signals, **scene, &view);
    }
    api->reset();
    auto books = (*scene)->end();
    return summary(context, books, directory.path() / "gantry.db", directory.own());
}
}  // namespace

void add_demo(CLI::App& app, Context& context) {
    auto& command = add_command(
        app, "demo", "See it work, with no hardware: virtual readers, moving tags, the gateway, the store",
        "gantry demo\ngantry demo --for 10s --headless\ngantry demo --dir ./demo-data");
    auto options = std::make_shared<DemoOptions>();
    add_duration(command, "--for", options->run_for, "End after this long (default: with Ctrl-C)");
    command.add_flag("--headless", options->headless,
                     "Print only the summary; what happens meanwhile goes to the log on stderr");
    command
        .add_option("--dir", options->dir,
                    "Keep the data here (default: a directory that goes with the demo)")
        ->type_name("DIR");
    on_run(command, context, [&context, options] { return demo(context, *options); });
}

}  // namespace gantry::cli
