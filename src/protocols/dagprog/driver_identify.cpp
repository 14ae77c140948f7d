// Finding out who is there and how it wants its commands (docs/protocols/dagprog.md section 9.2).
#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/dagprog/driver_setup.hpp"

namespace gantry::dagprog {

// "1", then the forms, then the version.
static constexpr std::uint8_t mark_kind = 1;

Bytes Remembered::mark() const {
    Bytes out{mark_kind, static_cast<std::uint8_t>(forms.stx ? 1 : 0),
              static_cast<std::uint8_t>(forms.separator)};
    out.insert(out.end(), version.begin(), version.end());
    return out;
}
std::optional<Remembered> Remembered::parse(ByteView mark) {
    if (mark.size() < 3 || mark[0] != mark_kind || mark[1] > 1 ||
        mark[2] > static_cast<std::uint8_t>(Separator::space))
        return {};
    return Remembered{std::string(as_text(mark.subspan(3))), {mark[1] == 1, static_cast<Separator>(mark[2])}};
}

namespace {

class Identify final : public IdentifyTask {
public:
    Identify(UnitState& unit, const Settings& settings, const std::optional<Remembered>& remembered)
        : unit_(unit), remembered_(remembered) {
        auto stx = settings.text("stx");
        if (stx == "auto") {
            bool first = remembered && remembered->forms.stx;
            stx_forms_ = {first, !first};
        } else {
            stx_forms_ = {stx == "yes"};
        }
        given_separator_ = parse_separator(settings.text("separator"));
        auto family = settings.text("family");
        unit_.family.reset();
        if (family != "auto") unit_.family = family == "icode1" ? Family::icode1 : Family::iso15693;
        unit_.proven = false;
        unit_.reading.reset();
        unit_.save_pending = false;
        unit_.now = {};
        ask_family_ = !unit_.family;
    }

    bool failed() const override { return stage_ == Stage::failed; }
    std::string why() const override { return why_; }

    std::optional<Request> next() override {
        switch (stage_) {
            case Stage::clear:  // ends half a line that somebody has left there
                return Request{.line = {byte_cr}, .until = Request::Until::time, .patience = clear_time};
            case Stage::version: {
                unit_.forms.stx = stx_forms_[stx_at_];
                auto request = unit_.ask(Code::version);
                request.tries = 1;
                return request;
            }
            case Stage::stop:
                return unit_.ask(Code::stop);
            case Stage::family:
                return unit_.ask(Code::power_up);
            case Stage::first_block:
                return unit_.ask(Code::first_block);
            case Stage::block_count:
                return unit_.ask(Code::block_count);
            case Stage::transmit:
                return unit_.ask(Code::transmit);
            case Stage::try_form:
                unit_.forms.separator = order()[form_at_];
                return unit_.set(probe_, other_);
            case Stage::see_form:
            case Stage::see_restored:
                return unit_.ask(probe_);
            case Stage::restore:
                return unit_.set(probe_, original_);
            case Stage::done:
            case Stage::failed:
                break;
        }
        return {};
    }

    void answered(const Reply& reply) override {
        switch (stage_) {
            case Stage::clear:
                stage_ = Stage::version;
                break;
            case Stage::version:
                return on_version(reply);
            case Stage::stop:
                if (!reply.ok()) return fail(fmt::format("stopping it: {}", reply.words()));
                stage_ = ask_family_ ? Stage::family : Stage::first_block;
                break;
            case Stage::family:
                // Only units for ISO15693 have a power-up mode (section 11, 7).
                if (!reply.ok() && reply.what != Reply::What::refused)
                    return fail(fmt::format("asking for its power-up mode: {}", reply.words()));
                unit_.family = reply.ok() ? Family::iso15693 : Family::icode1;
                stage_ = Stage::first_block;
                break;
            case Stage::first_block:
                unit_.now.first_block = number_in(reply);
                stage_ = Stage::block_count;
                break;
            case Stage::block_count:
                unit_.now.block_count = number_in(reply);
                stage_ = Stage::transmit;
                break;
            case Stage::transmit:
                unit_.now.transmit = number_in(reply);
                begin_probe();
                break;
            case Stage::try_form:
                echoed_ = number_in(reply) == other_;
                stage_ = Stage::see_form;
                break;
            case Stage::see_form:
                return on_seen(reply);
            case Stage::restore:
                stage_ = Stage::see_restored;
                break;
            case Stage::see_restored:
                unit_.now.at(probe_) = number_in(reply);
                if (unit_.now.at(probe_) != original_)
                    troubles.push_back({fault_setting,
                                        "a register that was changed to find out how the unit "
                                        "wants values could not be put back"});
                unit_.proven = true;
                stage_ = Stage::done;
                break;
            case Stage::done:
            case Stage::failed:
                break;
        }
    }

private:
    enum class Stage : std::uint8_t {
        clear,
        version,
        stop,
        family,
        first_block,
        block_count,
        transmit,
        try_form,
        see_form,
        restore,
        see_restored,
        done,
        failed
    };
    static constexpr std::chrono::milliseconds clear_time{150};
    static constexpr unsigned rounds = 3;

    void fail(std::string why) {
        why_ = std::move(why);
        stage_ = Stage::failed;
    }

    void on_version(const Reply& reply) {
        if (reply.ok() && !reply.values.empty()) {
            unit_.version = reply.values[0];
            stage_ = Stage::stop;
            return;
        }
        if (reply.what == Reply::What::refused) refused_ = true;
        if (++stx_at_ < stx_forms_.size()) return;
        stx_at_ = 0;
        if (++round_ < rounds) return;
        fail(refused_ ? "it answers ?? to every question for its version: is it a DAGProg unit? The "
                        "reader's `stx` setting can say how it wants to be asked"
                      : "nobody answers on the line: is the unit on, and are cable and baud rate right?");
    }

    // The most likely form first; what worked before wins.
    std::vector<Separator> order() const { return {Separator::tab, Separator::none, Separator::space}; }

    void begin_probe() {
        stage_ = Stage::done;
        if (given_separator_) {
            unit_.forms.separator = *given_separator_;
            unit_.proven = true;
            return;
        }
        if (remembered_ && remembered_->version == unit_.version &&
            remembered_->forms.stx == unit_.forms.stx) {
            unit_.forms.separator = remembered_->forms.separator;
            unit_.proven = true;
            return;
        }
        if (!choose_probe()) {
            troubles.push_back({fault_setting,
                                "how this unit wants values cannot be found out: it does not "
                                "tell its first block"});
            return;
        }
        stage_ = Stage::try_form;
    }

    // A register and another legal value for it. Not SV: nothing is kept for good.
    bool choose_probe() {
        auto first = unit_.now.first_block, count = unit_.now.block_count;
        if (!first || *first > last_block(unit_.kind())) return false;
        probe_ = Code::first_block;
        original_ = *first;
        other_ = *first > 0 ? *first - 1 : 1;
        // The blocks of an ICODE1 tag end with 15.
        if (*first == 0 && unit_.kind() == Family::icode1 && count.value_or(0) > 14) {
            probe_ = Code::block_count;
            original_ = *count;
            other_ = *count - 1;
        }
        return true;
    }

    void on_seen(const Reply& reply) {
        auto seen = number_in(reply);
        if (echoed_ && seen == other_) {
            stage_ = Stage::restore;
            return;
        }
        if (seen && *seen != original_) {
            unit_.now.at(probe_) = seen;
            return give_up(
                fmt::format("the unit took a value in another way than it was meant: it has {} now, "
                            "and had {}",
                            *seen, original_));
        }
        if (++form_at_ < order().size()) {
            stage_ = Stage::try_form;
            return;
        }
        give_up("the unit takes values in none of the forms that are known");
    }
    void give_up(std::string why) {
        unit_.forms.separator = Separator::tab;
        troubles.push_back({fault_setting, fmt::format("{}; {}", why, not_proven)});
        stage_ = Stage::done;
    }

    UnitState& unit_;
    std::optional<Remembered> remembered_;
    std::vector<bool> stx_forms_;
    std::optional<Separator> given_separator_;
    bool ask_family_ = false;
    Stage stage_ = Stage::clear;
    std::size_t stx_at_ = 0, form_at_ = 0;
    unsigned round_ = 0;
    bool refused_ = false, echoed_ = false;
    Code probe_ = Code::first_block;
    std::uint32_t original_ = 0, other_ = 0;
    std::string why_;
};

}  // namespace

std::unique_ptr<IdentifyTask> make_identify_task(UnitState& unit, const Settings& settings,
                                                 const std::optional<Remembered>& remembered) {
    return std::make_unique<Identify>(unit, settings, remembered);
}

}  // namespace gantry::dagprog
