#include "field/listening.hpp"

#include <algorithm>
#include <cmath>

#include "field/hash.hpp"

namespace gantry::field {

// How long what was heard can be asked for once more.
static constexpr SceneTime remembered{std::chrono::seconds{20}};

void Listening::hear(const Rounds& rounds, SceneTime from, SceneTime to, std::vector<SceneRead>& out) {
    if (from >= to) return;
    if (rounds.turned_db != rounds_.turned_db) cell_ = still_cell_ = INT64_MIN;
    rounds_ = rounds;
    if (from > heard_to_) {
        while (!past_.empty() && past_.back().at >= heard_to_) {
            lost(past_.back());
            past_.pop_back();
        }
        now_ = heard_from_ = from;
        switched_on();
    }
    if (heard_to_ < to) {
        while (now_ < to)
            step();
        heard_to_ = to;
    }
    auto first = std::ranges::lower_bound(past_, from, {}, &SceneRead::at);
    auto last = std::ranges::lower_bound(past_, to, {}, &SceneRead::at);
    out.insert(out.end(), first, last);
    while (!past_.empty() && past_.front().at < heard_to_ - remembered)
        past_.pop_front();
}

static std::int64_t cell_of(SceneTime time, SceneTime size) {
    auto cell = time / size;
    return time % size < SceneTime{} ? cell - 1 : cell;
}

const std::vector<Powered>& Listening::powered() {
    auto cell_now = cell_of(now_, cell);
    if (cell_now == cell_) return powered_;
    cell_ = cell_now;
    ++looks_;
    if (auto still_now = cell_of(now_, still_cell); still_now != still_cell_) {
        still_cell_ = still_now;
        still_.clear();
        world_.still(antenna_, rounds_.turned_db, still_now * still_cell, still_);
    }
    powered_ = still_;
    world_.moving(antenna_, rounds_.turned_db, cell_now * cell, powered_);
    return powered_;
}

void Listening::pass_cell() {
    now_ = (cell_of(now_, cell) + 1) * cell;
}

// Readers measure strength to about half a dB.
void Listening::read(const Powered& tag, SceneTime at) {
    auto chance = hash_of({world_.tags()[tag.tag].key, antenna_, static_cast<std::uint64_t>(at.count())});
    auto signal =
        world_.signal(tag.tag, antenna_, rounds_.turned_db, at).value_or(World::Signal{tag.rssi_dbm});
    auto rssi = signal.rssi_dbm + fraction(chance) - 0.5;
    past_.push_back({tag.tag, static_cast<float>(rssi), signal.phase, at});
}

namespace {

class Gen2Listening final : public Listening {
public:
    Gen2Listening(const World& world, std::size_t antenna, SessionFlags* flags)
        : Listening(world, antenna), flags_(flags), read_by_(flags == nullptr ? world.tags().size() : 0) {}

private:
    struct Reply {
        std::uint32_t slot;
        Powered tag;
    };

    void switched_on() override {
        in_round_ = in_frame_ = false;
        carrier_off();
    }
    void lost(const SceneRead& read) override {
        if (flags_ != nullptr) flags_->forget(read.tag);
    }
    void carrier_off() {
        ++carrier_;
        on_since_ = now();
    }

    void step() override {
        if (!in_frame_)
            begin_frame();
        else
            slot();
    }

    bool is_silent(std::uint32_t tag) {
        if (flags_ == nullptr) return read_by_[tag] == carrier_;
        return flags_->is_set(tag, now());
    }

    void begin_frame() {
        auto timing = timing_of(rounds().mode);
        if (now() - on_since_ > channel_time(world().scenario().region)) {  // to the next channel
            end_round(timing);
            return;
        }
        find_awake();
        if (!in_round_ && awake_.empty() && (flags_ != nullptr || powered().empty())) {
            pass_cell();  // many rounds in which nobody answers
            return;
        }
        if (!in_round_) q_ = QAlgorithm(rounds().q);
        pass(in_round_ ? timing.adjust : timing.query);
        in_round_ = in_frame_ = true;
        collided_ = false;
        slot_ = 0;
        next_ = 0;
        auto slots = (std::uint64_t{1} << q_.q()) - 1;
        replies_.clear();
        for (auto& tag : awake_)
            replies_.push_back({static_cast<std::uint32_t>(chance(tag.tag) & slots), tag});
        std::ranges::stable_sort(replies_, {}, &Reply::slot);
    }
    // Those with power whose flag says A. Thousands may be silent, so they are not asked for every frame.
    void find_awake() {
        auto& tags = powered();
        auto silent = [this](const Powered& tag) { return is_silent(tag.tag); };
        if (auto look = std::pair(looks(), carrier_); look != looked_) {
            looked_ = look;
            awake_.clear();
            std::ranges::remove_copy_if(tags, std::back_inserter(awake_), silent);
        } else {
            std::erase_if(awake_, silent);
        }
    }
    std::uint64_t chance(std::uint32_t tag) const {
        return hash_of({world().tags()[tag].key, antenna(), static_cast<std::uint64_t>(now().count())});
    }

    void slot() {
        auto timing = timing_of(rounds().mode);
        auto first = next_;
        while (next_ < replies_.size() && replies_[next_].slot == slot_)
            ++next_;
        bool changed = false;
        auto answers = std::span(replies_).subspan(first, next_ - first);
        if (answers.empty()) {
            pass(timing.empty);
            changed = q_.empty_slot();
        } else if (auto* heard = loudest(answers)) {
            auto start = now();
            pass(timing.success);
            // Below its floor a reader gets only part of them right; the tag stays as it was.
            auto right = 1 / (1 + std::exp(-(heard->rssi_dbm - reader_floor_dbm)));
            if (fraction(mix(chance(heard->tag))) < right) take(*heard, start + timing.success);
        } else {
            pass(timing.collision);
            collided_ = true;
            changed = q_.collision();
        }
        ++slot_;
        if (changed)
            in_frame_ = false;
        else if (slot_ == std::uint32_t{1} << q_.q())
            end_frame(timing);
    }

    // The one that can be understood: alone, or so much stronger than all others together.
    static const Powered* loudest(std::span<const Reply> answers) {
        constexpr double capture_db = 10;
        if (answers.size() == 1) return &answers.front().tag;
        auto best = std::ranges::max_element(answers, {}, [](auto& each) { return each.tag.rssi_dbm; });
        double others = 0;
        for (auto& each : answers)
            if (&each != &*best) others += std::pow(10, each.tag.rssi_dbm / 10);
        return best->tag.rssi_dbm >= 10 * std::log10(others) + capture_db ? &best->tag : nullptr;
    }

    void take(const Powered& tag, SceneTime at) {
        read(tag, at);
        if (flags_ == nullptr)
            read_by_[tag.tag] = carrier_;
        else
            flags_->read(tag.tag, at, world().tags()[tag.tag].key);
    }

    void end_frame(const Gen2Timing& timing) {
        in_frame_ = false;
        if (!collided_) end_round(timing);
    }
    void end_round(const Gen2Timing& timing) {
        in_round_ = false;
        pass(timing.between);
        carrier_off();
    }

    SessionFlags* flags_;
    std::vector<std::uint64_t> read_by_;  // session 0: the carrier that a tag was read by last
    std::uint64_t carrier_ = 0;
    SceneTime on_since_{};
    QAlgorithm q_{4};
    bool in_round_ = false, in_frame_ = false, collided_ = false;
    std::uint32_t slot_ = 0;
    std::size_t next_ = 0;
    std::vector<Powered> awake_;
    std::pair<std::uint64_t, std::uint64_t> looked_{};  // the look and the carrier that they are of
    std::vector<Reply> replies_;                        // of this frame, by slot
};

// ISO/IEC 15693 at its high data rate: a request, then slots; tags answer in the slot of the next four bits
// of their UID, and where several do, the reader asks for these bits and the next ones. I-CODE 1 is taken to
// do the same. Without anticollision there is one slot, and two tags in it are nobody.
class HfListening final : public Listening {
public:
    HfListening(const World& world, std::size_t antenna) : Listening(world, antenna) {}

private:
    // Bits of 37.76 microseconds: a request of 40, an answer of 96, with their frames.
    static constexpr SceneTime request{1'700'000}, empty{700'000}, answer{4'600'000};
    static constexpr SceneTime handling{12'000'000};  // what a reader itself needs for a UID
    static constexpr SceneTime pause{5'000'000};      // and between two inventories

    void switched_on() override { asking_.clear(); }

    void step() override {
        if (powered().empty()) return pass_cell();
        auto tags = powered();
        if (!rounds().anticollision) {
            pass(request + answer);
            if (tags.size() == 1) take(tags.front());
            return pass(pause);
        }
        if (asking_.empty()) asking_.emplace_back();
        auto mask = std::move(asking_.front());
        asking_.erase(asking_.begin());
        pass(request);
        for (std::uint8_t slot = 0; slot < 16; ++slot) {
            const Powered* heard = nullptr;
            std::size_t count = 0;
            mask.push_back(slot);
            for (auto& tag : tags) {
                if (!matches(tag, mask)) continue;
                heard = &tag;
                ++count;
            }
            pass(count == 0 ? empty : answer);
            if (count == 1) take(*heard);
            if (count > 1 && mask.size() < 16) asking_.push_back(mask);
            mask.pop_back();
        }
        if (asking_.empty()) pass(pause);
    }

    bool matches(const Powered& tag, const std::vector<std::uint8_t>& mask) const {
        auto uid = world().tags()[tag.tag].memory->id().view();
        for (std::size_t i = 0; i < mask.size() && i / 2 < uid.size(); ++i) {
            auto byte = uid[uid.size() - 1 - i / 2];  // the last byte goes over the air first
            if ((i % 2 == 0 ? byte & 0x0F : byte >> 4) != mask[i]) return false;
        }
        return true;
    }
    void take(const Powered& tag) {
        read(tag, now());
        pass(handling);
    }

    std::vector<std::vector<std::uint8_t>> asking_;  // the first bits of UIDs still to be told apart
};

}  // namespace

std::unique_ptr<Listening> listen_gen2(const World& world, std::size_t antenna, SessionFlags* flags) {
    return std::make_unique<Gen2Listening>(world, antenna, flags);
}
std::unique_ptr<Listening> listen_hf(const World& world, std::size_t antenna) {
    return std::make_unique<HfListening>(world, antenna);
}

}  // namespace gantry::field
