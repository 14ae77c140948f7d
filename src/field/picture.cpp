#include "field/picture.hpp"

#include <algorithm>
#include <array>
#include <numbers>

#include <fmt/format.h>

#include "base/text.hpp"
#include "base/time.hpp"
#include "field/propagation.hpp"

namespace gantry::field {

namespace {
constexpr double wide = 1240, side_column = 330, margin = 24, header = 64;
constexpr double weakest_dbm = -75, strongest_dbm = -35;  // the ends of the colour scale
constexpr std::chrono::milliseconds fresh{500};           // a read not older than this is "now"
constexpr std::size_t most_lines = 400, most_titles = 1000;

constexpr std::array<std::string_view, 6> reader_colours = {"#1f6fb4", "#d95f02", "#2a9d4b",
                                                            "#8e44ad", "#b8860b", "#c2185b"};
std::string_view colour_of_reader(std::size_t reader) {
    return reader_colours[reader % reader_colours.size()];
}

// Text of a file in XML.
std::string safe(std::string_view text) {
    std::string out;
    for (char c : printable(text)) {
        if (c == '&')
            out += "&amp;";
        else if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else if (c == '"')
            out += "&quot;";
        else
            out += c;
    }
    return out;
}

// Weak reads are blue, strong ones red, by way of yellow.
std::string colour_of(double rssi_dbm) {
    struct Rgb {
        double r, g, b;
    };
    static constexpr Rgb stops[] = {
        {49, 54, 149}, {69, 140, 190}, {240, 220, 110}, {240, 130, 60}, {165, 0, 38}};
    auto part = std::clamp((rssi_dbm - weakest_dbm) / (strongest_dbm - weakest_dbm), 0.0, 1.0) * 4;
    auto stop = std::min(static_cast<std::size_t>(part), std::size_t{3});
    auto rest = part - static_cast<double>(stop);
    auto mixed = [&](double Rgb::*of) {
        return static_cast<int>(stops[stop].*of * (1 - rest) + stops[stop + 1].*of * rest);
    };
    return fmt::format("#{:02x}{:02x}{:02x}", mixed(&Rgb::r), mixed(&Rgb::g), mixed(&Rgb::b));
}

// A flat view of the space, in a box of the picture.
struct View {
    std::string_view name, across, up;  // and what its axes are called
    Vec right, upward, deep;
    double low_u = 0, high_u = 1, low_v = 0, high_v = 1;  // metres that it shows
    double left = 0, top = 0, scale = 1;

    double u(Vec at) const { return dot(at, right); }
    double v(Vec at) const { return dot(at, upward); }
    double x(double metres) const { return left + (metres - low_u) * scale; }
    double y(double metres) const { return top + (high_v - metres) * scale; }
    double width() const { return (high_u - low_u) * scale; }
    double height() const { return (high_v - low_v) * scale; }
};

class Picture {
public:
    Picture(const Scene& scene, const Survey& survey)
        : scenario_(scene.scenario()), survey_(survey), air_(scenario_), tags_(scene.look(survey.now())) {}

    std::string draw() {
        choose_tag();
        lay_out();
        for (std::size_t i = 0; i < views_.size(); ++i)
            view(views_[i], i);
        column();
        high_ = std::max(high_, row_ + margin);
        return begin() + out_ + "</svg>\n";
    }

private:
    using TagReads = Survey::TagReads;

    bool is_fresh(const TagReads& reads) const {
        return reads.last && survey_.now() - reads.last->at <= fresh;
    }

    // Beams are drawn for the tags that there are most of.
    void choose_tag() {
        std::uint32_t most = 0;
        for (auto& group : scenario_.groups) {
            if (group.technology != event::Technology::epc_gen2 || group.count <= most) continue;
            most = group.count;
            needs_dbm_ = group.sensitivity_dbm + group.loss_db;
            beam_words_ = fmt::format("where tags of {} wake, echoes aside", safe(group.name));
        }
    }

    void lay_out() {
        views_[0] = {"from above", "x", "y", {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        views_[1] = {"from the side", "x", "z", {1, 0, 0}, {0, 0, 1}, {0, -1, 0}};
        std::vector<Vec> points;
        for (auto& reader : scenario_.readers)
            for (auto& antenna : reader.antennas)
                points.insert(points.end(), {antenna.position, antenna.towards});
        for (auto& tag : tags_)
            if (tag.place) points.push_back(*tag.place);
        double room = wide - side_column - 3 * margin;
        for (auto& view : views_) {
            auto bounds = [&](auto of, double& low, double& high) {
                auto [least, most] = std::ranges::minmax_element(points, {}, of);
                auto around = std::max(0.3, 0.1 * (of(*most) - of(*least)));
                low = of(*least) - around;
                high = of(*most) + around;
            };
            bounds([&](Vec at) { return view.u(at); }, view.low_u, view.high_u);
            bounds([&](Vec at) { return view.v(at); }, view.low_v, view.high_v);
        }
        // One scale for both, and neither is higher than it can be looked at.
        auto scale = room / (views_[0].high_u - views_[0].low_u);
        for (auto& view : views_)
            scale = std::min(scale, 520 / (view.high_v - view.low_v));
        double top = header + margin;
        for (auto& view : views_) {
            // What room is left shows more of the space.
            auto more = (room / scale - (view.high_u - view.low_u)) / 2;
            view.low_u -= more;
            view.high_u += more;
            view.scale = scale;
            view.left = margin + 12;
            view.top = top;
            top += view.height() + 56;
        }
        high_ = top;
        radius_ = std::clamp(0.03 * scale, tags_.size() > most_titles ? 1.6 : 2.6, 5.0);
    }

    std::string begin() const {
        auto since = std::chrono::duration<double>(survey_.now() - survey_.start()).count();
        return fmt::format(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1:.0f}\" width=\"{0}\" "
            "height=\"{1:.0f}\" "
            "font-family=\"'DejaVu Sans', Helvetica, Arial, sans-serif\" font-size=\"12\">\n"
            "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
            "<text x=\"{2}\" y=\"34\" font-size=\"20\" font-weight=\"bold\" fill=\"#222\">{3}</text>\n"
            "<text x=\"{2}\" y=\"54\" fill=\"#555\">{4}</text>\n"
            "<text x=\"{5}\" y=\"34\" font-size=\"20\" text-anchor=\"end\" fill=\"#222\">t = {6:.4g} "
            "s</text>\n",
            wide, high_, margin, safe(scenario_.name), safe(scenario_.about), wide - margin, since);
    }

    // --- a view
    // ---------------------------------------------------------------------------------------------

    void view(const View& view, std::size_t number) {
        out_ += fmt::format(
            "<g class=\"view\">\n<text x=\"{:.1f}\" y=\"{:.1f}\" fill=\"#555\">{} (metres, {} and {})"
            "</text>\n<clipPath id=\"view{}\"><rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" "
            "height=\"{:.1f}\"/></clipPath>\n",
            view.left, view.top - 6, view.name, view.across, view.up, number, view.left, view.top,
            view.width(), view.height());
        grid(view);
        out_ += fmt::format("<g clip-path=\"url(#view{})\">\n", number);
        for (std::size_t i = 0; i < scenario_.readers.size(); ++i)
            for (auto& antenna : scenario_.readers[i].antennas)
                beam(view, antenna, colour_of_reader(i));
        lines(view);
        tags(view);
        out_ += "</g>\n";
        for (std::size_t i = 0; i < scenario_.readers.size(); ++i)
            for (auto& antenna : scenario_.readers[i].antennas)
                mark(view, antenna, colour_of_reader(i));
        write_labels();
        out_ += "</g>\n";
    }

    void grid(const View& view) {
        out_ += fmt::format(
            "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"#fafafa\" "
            "stroke=\"#bbb\"/>\n<g stroke=\"#e4e4e4\" fill=\"#888\" font-size=\"10\">\n",
            view.left, view.top, view.width(), view.height());
        // Lines 50 pixels apart or more.
        double step = 0.1;
        for (double each : {0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0})
            if (step * view.scale < 50) step = each;
        for (auto metres = std::ceil(view.low_u / step) * step; metres <= view.high_u; metres += step)
            out_ += fmt::format(
                "<path d=\"M{0:.1f} {1:.1f}v{2:.1f}\"/><text x=\"{0:.1f}\" y=\"{3:.1f}\" "
                "stroke=\"none\" text-anchor=\"middle\">{4:.4g}</text>\n",
                view.x(metres), view.top, view.height(), view.top + view.height() + 13,
                std::abs(metres) < 1e-9 ? 0 : metres);
        for (auto metres = std::ceil(view.low_v / step) * step; metres <= view.high_v; metres += step)
            out_ += fmt::format(
                "<path d=\"M{0:.1f} {1:.1f}h{2:.1f}\"/><text x=\"{3:.1f}\" y=\"{4:.1f}\" "
                "stroke=\"none\" text-anchor=\"end\">{5:.4g}</text>\n",
                view.left, view.y(metres), view.width(), view.left - 4, view.y(metres) + 3,
                std::abs(metres) < 1e-9 ? 0 : metres);
        out_ += "</g>\n";
    }

    // The outline of the space in which a bare tag wakes, as it looks from here.
    void beam(const View& view, const AntennaSpec& antenna, std::string_view colour) {
        Beam beam(antenna);
        std::string points;
        for (int turn = 0; turn < 360; turn += 4) {
            auto angle = turn * std::numbers::pi / 180;
            auto flat = view.right * std::cos(angle) + view.upward * std::sin(angle);
            double farthest = 0;
            for (int raise = -80; raise <= 80; raise += 8) {
                auto tilt = raise * std::numbers::pi / 180;
                auto direction = flat * std::cos(tilt) + view.deep * std::sin(tilt);
                farthest = std::max(
                    farthest, std::cos(tilt) * reach(air_, beam, direction, antenna.power_dbm, needs_dbm_));
            }
            auto at = antenna.position + flat * farthest;
            points += fmt::format("{:.1f},{:.1f} ", view.x(view.u(at)), view.y(view.v(at)));
        }
        out_ += fmt::format(
            "<polygon class=\"beam\" points=\"{}\" fill=\"{}\" fill-opacity=\"0.07\" stroke=\"{}\" "
            "stroke-opacity=\"0.5\" stroke-dasharray=\"4 3\"/>\n",
            points, colour, colour);
    }

    void mark(const View& view, const AntennaSpec& antenna, std::string_view colour) {
        auto x = view.x(view.u(antenna.position)), y = view.y(view.v(antenna.position));
        auto facing = unit(antenna.towards - antenna.position);
        auto u = dot(facing, view.right), v = dot(facing, view.upward);
        auto size = std::sqrt(u * u + v * v);
        // A plate seen from its edge, and the way it looks; from behind or in front just a plate.
        auto du = size > 0.1 ? u / size : 0, dv = size > 0.1 ? -v / size : 0;
        if (size > 0.1)
            out_ += fmt::format(
                "<path class=\"antenna\" d=\"M{:.1f} {:.1f}L{:.1f} {:.1f}M{:.1f} {:.1f}l{:.1f} {:.1f}\" "
                "stroke=\"{}\" stroke-width=\"4\" stroke-linecap=\"round\"/>\n",
                x - 9 * dv, y + 9 * du, x + 9 * dv, y - 9 * du, x, y, 10 * du, 10 * dv, colour);
        else
            out_ += fmt::format(
                "<rect class=\"antenna\" x=\"{:.1f}\" y=\"{:.1f}\" width=\"14\" height=\"14\" rx=\"3\" "
                "fill=\"{}\"/>\n",
                x - 7, y - 7, colour);
        // The name stands behind it; those of one spot stand together.
        auto anchor = du > 0.5 ? "end" : du < -0.5 ? "start" : "middle";
        auto shift = dv >= 0.5 ? -12.0 : dv <= -0.5 ? 20.0 : du == 0 && dv == 0 ? 22.0 : 4.0;
        for (auto& label : labels_)
            if (std::abs(label.x - x) < 16 && std::abs(label.y - y) < 12) {
                label.words += ", " + safe(antenna.name);
                return;
            }
        labels_.push_back({x, y, du, shift, anchor, colour, safe(antenna.name)});
    }
    void write_labels() {
        for (auto& label : labels_)
            out_ += fmt::format(
                "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" fill=\"{}\" stroke=\"#fff\" "
                "stroke-width=\"3\" paint-order=\"stroke\" font-size=\"11\">{}</text>\n",
                label.x - 12 * label.du, label.y + label.shift, label.anchor, label.colour, label.words);
        labels_.clear();
    }

    // From each antenna to what it has just read.
    void lines(const View& view) {
        out_ += "<g stroke-width=\"0.8\" stroke-opacity=\"0.4\">\n";
        std::size_t drawn = 0;
        for (std::size_t i = 0; i < tags_.size() && drawn < most_lines; ++i) {
            auto& reads = survey_.tags()[i];
            if (!tags_[i].place || !is_fresh(reads)) continue;
            auto& antenna = scenario_.readers[reads.last->reader].antennas[reads.last->antenna - 1U];
            out_ += fmt::format("<path class=\"reads\" d=\"M{:.1f} {:.1f}L{:.1f} {:.1f}\" stroke=\"{}\"/>\n",
                                view.x(view.u(antenna.position)), view.y(view.v(antenna.position)),
                                view.x(view.u(*tags_[i].place)), view.y(view.v(*tags_[i].place)),
                                colour_of_reader(reads.last->reader));
            ++drawn;
        }
        out_ += "</g>\n";
    }

    // Those that matter least first, so that the others lie on top.
    void tags(const View& view) {
        out_ += "<g stroke-width=\"1\">\n";
        for (int turn = 0; turn < 3; ++turn)
            for (std::size_t i = 0; i < tags_.size(); ++i) {
                auto& reads = survey_.tags()[i];
                auto state = is_fresh(reads) ? 2 : reads.last ? 1 : 0;
                if (tags_[i].place && state == turn) tag(view, i, state);
            }
        out_ += "</g>\n";
    }

    void tag(const View& view, std::size_t number, int state) {
        auto& tag = tags_[number];
        auto& reads = survey_.tags()[number];
        std::string look;
        if (state == 0)
            look = tag.powered ? R"(fill="#fff" stroke="#333")"
                               : R"(fill="#ddd" stroke="#aaa" stroke-width="0.5")";
        else if (state == 1)
            look = fmt::format(R"(fill="{}" fill-opacity="0.55")", colour_of(reads.last->rssi_dbm));
        else
            look =
                fmt::format(R"(fill="{}" stroke="#111" stroke-width="0.7")", colour_of(reads.last->rssi_dbm));
        out_ += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{:.1f}\" {}", view.x(view.u(*tag.place)),
                            view.y(view.v(*tag.place)), radius_, look);
        if (tags_.size() > most_titles) {
            out_ += "/>\n";
            return;
        }
        out_ += fmt::format("><title>{}: {}", to_hex(tag.id.view()), reads.reads == 0 ? "not read" : "");
        if (reads.last)
            out_ += fmt::format("{} reads, last {:.1f} dBm by {}", reads.reads, reads.last->rssi_dbm,
                                safe(scenario_.readers[reads.last->reader].name));
        out_ += "</title></circle>\n";
    }

    // --- the column at the right
    // ------------------------------------------------------------------------------

    void text(double indent, std::string_view words, std::string_view look = R"(fill="#222")") {
        out_ += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" {}>{}</text>\n", column_left() + indent, row_,
                            look, words);
    }
    static double column_left() { return wide - side_column; }
    void heading(std::string_view words) {
        row_ += 12;
        text(0, words, R"(font-weight="bold" font-size="13" fill="#222")");
        row_ += 20;
    }
    void sample(std::string_view shape, std::string_view words) {
        out_ += fmt::format("<g transform=\"translate({:.1f} {:.1f})\">{}</g>\n", column_left() + 10,
                            row_ - 4, shape);
        text(26, words);
        row_ += 19;
    }

    void column() {
        row_ = header + margin;
        legend();
        readers();
        groups();
    }

    void legend() {
        heading("Tags");
        auto dot = [](std::string_view look) { return fmt::format("<circle r=\"5\" {}/>", look); };
        auto middle = colour_of((weakest_dbm + strongest_dbm) / 2);
        auto now = to_text(std::chrono::microseconds(fresh));
        sample(dot(fmt::format(R"(fill="{}" stroke="#111")", middle)),
               fmt::format("read within the last {}", now));
        sample(dot(fmt::format(R"(fill="{}" fill-opacity="0.55")", middle)), "read before that");
        sample(dot(R"(fill="#fff" stroke="#333")"), "has power, not read yet");
        sample(dot(R"(fill="#ddd" stroke="#aaa")"), "out of reach, never read");
        row_ += 4;
        text(0, "colour: strength of the last read, dBm");
        row_ += 8;
        constexpr int steps = 40;
        for (int i = 0; i < steps; ++i)
            out_ += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"6.2\" height=\"10\" fill=\"{}\"/>\n",
                                column_left() + i * 6, row_,
                                colour_of(weakest_dbm + (strongest_dbm - weakest_dbm) * i / (steps - 1)));
        row_ += 23;
        for (auto dbm : {-75, -65, -55, -45, -35})
            out_ += fmt::format(
                "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\" font-size=\"10\" "
                "fill=\"#555\">{}</text>\n",
                column_left() + 4 + (dbm + 75) * 5.8, row_, dbm);
        row_ += 18;
        sample("<path d=\"M-8 0h16\" stroke=\"#666\" stroke-dasharray=\"4 3\"/>", beam_words_);
        sample("<path d=\"M-8 0h16\" stroke=\"#666\" stroke-width=\"0.8\"/>",
               fmt::format("has read it within the last {}", now));
    }

    void readers() {
        heading("Readers");
        auto seconds = std::chrono::duration<double>(survey_.now() - survey_.start()).count();
        for (std::size_t i = 0; i < scenario_.readers.size(); ++i) {
            auto& reader = scenario_.readers[i];
            auto& reads = survey_.readers()[i];
            sample(fmt::format("<rect x=\"-6\" y=\"-6\" width=\"12\" height=\"12\" rx=\"3\" fill=\"{}\"/>",
                               colour_of_reader(i)),
                   fmt::format("{} ({})", safe(reader.name), safe(reader.make)));
            text(26,
                 fmt::format("{} reads, {:.0f}/s, of {} tags", reads.reads,
                             seconds > 0 ? static_cast<double>(reads.reads) / seconds : 0, reads.tags),
                 R"(fill="#555")");
            row_ += 19;
        }
    }

    void groups() {
        heading("Groups of tags");
        for (std::uint32_t group = 0; group < scenario_.groups.size(); ++group) {
            auto is_there = [&](const Scene::TagView& tag) { return tag.group == group && tag.place; };
            text(0, safe(scenario_.groups[group].name));
            row_ += 16;
            text(26,
                 fmt::format("{} of {} are here, {} have been read", std::ranges::count_if(tags_, is_there),
                             scenario_.groups[group].count, survey_.read_of(group)),
                 R"(fill="#555")");
            row_ += 19;
        }
    }

    const Scenario& scenario_;
    const Survey& survey_;
    Surroundings air_;
    std::vector<Scene::TagView> tags_;
    std::array<View, 2> views_;
    struct Label {
        double x, y, du, shift;
        std::string_view anchor, colour;
        std::string words;
    };
    std::vector<Label> labels_;
    double needs_dbm_ = -18;
    std::string beam_words_ = "where a tag wakes, echoes aside";
    double high_ = 0, radius_ = 3, row_ = 0;
    std::string out_;
};
}  // namespace

std::string draw(const Scene& scene, const Survey& survey) {
    return Picture(scene, survey).draw();
}

}  // namespace gantry::field
