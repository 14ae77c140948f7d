#include "field/memory_gen2.hpp"

#include <algorithm>

#include "field/field.hpp"
#include "field/hash.hpp"

namespace gantry::field {

// Words of the reserved and of the EPC bank.
static constexpr std::uint32_t kill_password_word = 0, access_password_word = 2;
static constexpr std::uint32_t crc_word = 0, pc_word = 1, epc_word = 2, xpc_word = 0x21;
static constexpr std::size_t least_epc_words = 6;  // room for 96 bits
static constexpr unsigned user_indicator = 0x0400, xpc_indicator = 0x0200;

// A pair of lock bits: the lower one makes the upper one permanent.
static constexpr unsigned permanent = 1, locked = 2;

// BlockPermalock: the standard leaves the size of a block to the tag's maker.
static constexpr std::size_t block_words = 4;

static std::size_t index_of(Bank bank) {
    return static_cast<std::size_t>(bank);
}

static void put16(Bytes& bytes, std::size_t word, unsigned value) {
    bytes[word * 2] = static_cast<std::uint8_t>(value >> 8);
    bytes[word * 2 + 1] = static_cast<std::uint8_t>(value);
}
static void put32(Bytes& bytes, std::size_t word, std::uint32_t value) {
    put16(bytes, word, value >> 16);
    put16(bytes, word + 1, value & 0xFFFF);
}
static std::uint16_t get16(const Bytes& bytes, std::size_t word) {
    return static_cast<std::uint16_t>(bytes[word * 2] << 8 | bytes[word * 2 + 1]);
}

// Class E2h, no serial structure announced, a mask designer number of all ones that nobody has, and eight
// bytes of serial number.
static Bytes made_tid(const event::TagId& id) {
    Bytes tid{0xE2, 0x7F, 0xF0, 0x01};
    auto serial = hash_of(id.view());
    for (int shift = 56; shift >= 0; shift -= 8)
        tid.push_back(static_cast<std::uint8_t>(serial >> shift));
    return tid;
}

// CRC-16 of ISO/IEC 18000-63: polynomial 0x1021, most significant bit first, starts at 0xFFFF, complemented.
static std::uint16_t gen2_crc(ByteView bytes) {
    unsigned crc = 0xFFFF;
    for (auto byte : bytes) {
        crc ^= static_cast<unsigned>(byte) << 8;
        for (int bit = 0; bit < 8; ++bit)
            crc = (crc & 0x8000u) != 0 ? crc << 1 ^ 0x1021u : crc << 1;
    }
    return static_cast<std::uint16_t>(~crc);
}

static Bytes padded_to_words(Bytes bytes) {
    if (bytes.size() % 2 != 0) bytes.push_back(0);
    return bytes;
}

Gen2Memory::Gen2Memory(const TagSpec& spec) : TagMemory(spec), xpc_(spec.xpc) {
    banks_[index_of(Bank::user)] = spec.user.empty() ? Bytes(32) : padded_to_words(spec.user);
    permalocked_.resize((banks_[index_of(Bank::user)].size() / 2 + block_words - 1) / block_words);

    auto& reserved = banks_[index_of(Bank::reserved)];
    reserved.resize(8);
    put32(reserved, kill_password_word, spec.kill_password);
    put32(reserved, access_password_word, spec.access_password);

    banks_[index_of(Bank::tid)] = spec.tid.empty() ? made_tid(spec.id) : padded_to_words(spec.tid);
    locks_ = (locked | permanent) << 2;  // makers lock the TID for ever

    auto& epc = banks_[index_of(Bank::epc)];
    auto id = spec.id.view();
    auto words = (id.size() + 1) / 2;
    epc_end_ = epc_word + std::max(words, least_epc_words);
    epc.resize((xpc_ ? xpc_word + 1 : epc_end_) * 2);
    std::ranges::copy(id, epc.begin() + epc_word * 2);
    if (xpc_) put16(epc, xpc_word, *xpc_);
    put16(epc, pc_word, static_cast<unsigned>(words << 11));
    epc_written();
}

// What a tag works out by itself: the PC word's indicators of user memory and of an XPC word, the CRC-16 over
// PC and EPC, and so what it answers with.
void Gen2Memory::epc_written() {
    auto& epc = banks_[index_of(Bank::epc)];
    const auto& user = banks_[index_of(Bank::user)];
    auto pc = get16(epc, pc_word) & ~(user_indicator | xpc_indicator);
    if (std::ranges::any_of(user, [](auto byte) { return byte != 0; })) pc |= user_indicator;
    if (xpc_.value_or(0) != 0) pc |= xpc_indicator;
    put16(epc, pc_word, pc);

    auto size = static_cast<std::size_t>(pc >> 11) * 2;
    auto covered = ByteView(epc).subspan(pc_word * 2, 2 + size);
    put16(epc, crc_word, gen2_crc(covered));
    answer_as(event::TagId(covered.subspan(2)));
}

std::uint32_t Gen2Memory::password_at(std::size_t word) const {
    const auto& reserved = banks_[index_of(Bank::reserved)];
    return std::uint32_t{get16(reserved, word)} << 16 | get16(reserved, word + 1);
}

// A tag without an access password is secured from the start; a wrong password ends the talk.
Gen2Memory::Access Gen2Memory::access(std::uint32_t password) const {
    auto own = password_at(access_password_word);
    if (password == own) return Access::secured;
    return password == 0 ? Access::open : Access::refused;
}

// Order of the pairs, from the most significant: kill password, access password, EPC, TID, user.
unsigned Gen2Memory::lock_bits(Bank bank, std::uint32_t word) const {
    unsigned shift = bank == Bank::reserved ? (word < access_password_word ? 8 : 6)
                     : bank == Bank::epc    ? 4
                     : bank == Bank::tid    ? 2
                                            : 0;
    return locks_ >> shift & 3u;
}

static bool allows(unsigned bits, bool secured) {
    if ((bits & locked) == 0) return true;
    return secured && (bits & permanent) == 0;
}

// Between the end of the EPC memory and the XPC word there is nothing.
bool Gen2Memory::has(Bank bank, std::size_t word) const {
    if (word >= banks_[index_of(bank)].size() / 2) return false;
    return bank != Bank::epc || word < epc_end_ || (xpc_ && word == xpc_word);
}

bool Gen2Memory::may_write(Bank bank, std::uint32_t word, bool secured) const {
    if (bank == Bank::user && permalocked_[word / block_words]) return false;
    return allows(lock_bits(bank, word), secured);
}

AirResult<Bytes> Gen2Memory::read(Bank bank, std::uint32_t word, std::uint32_t words,
                                  std::uint32_t password) const {
    const auto& memory = banks_[index_of(bank)];
    if (!fits(memory.size() / 2, word, words)) return tl::unexpected(AirError::bad_address);
    std::size_t end = word;
    while (has(bank, end) && (words == 0 || end < word + words))
        ++end;
    if (end == word || (words != 0 && end != word + words)) return tl::unexpected(AirError::bad_address);
    auto how = access(password);
    if (how == Access::refused) return tl::unexpected(AirError::locked);
    // Only the passwords can be locked against reading.
    for (auto at = word; bank == Bank::reserved && at < end; ++at)
        if (!allows(lock_bits(bank, at), how == Access::secured)) return tl::unexpected(AirError::locked);
    auto from = memory.begin();
    return Bytes(from + static_cast<std::ptrdiff_t>(word) * 2, from + static_cast<std::ptrdiff_t>(end) * 2);
}

AirResult<void> Gen2Memory::write(Bank bank, std::uint32_t word, ByteView data, std::uint32_t password) {
    auto& memory = banks_[index_of(bank)];
    auto words = data.size() / 2;
    if (data.empty() || data.size() % 2 != 0 || !fits(memory.size() / 2, word, words))
        return tl::unexpected(AirError::bad_address);
    auto how = access(password);
    if (how == Access::refused) return tl::unexpected(AirError::locked);
    for (auto at = word; at < word + words; ++at) {
        if (!has(bank, at)) return tl::unexpected(AirError::bad_address);
        if (!may_write(bank, at, how == Access::secured)) return tl::unexpected(AirError::locked);
        // CRC and XPC are the tag's own.
        if (bank == Bank::epc && (at == crc_word || at == xpc_word)) return tl::unexpected(AirError::locked);
    }
    // The PC word must not announce more EPC than there is memory.
    if (bank == Bank::epc && word == pc_word && data[0] >> 3u > epc_end_ - epc_word)
        return tl::unexpected(AirError::bad_address);
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    std::ranges::copy(data, memory.begin() + static_cast<std::ptrdiff_t>(word) * 2);
    epc_written();
    return {};
}

AirResult<void> Gen2Memory::lock(AirLock lock, std::uint32_t password) {
    if (access(password) != Access::secured) return tl::unexpected(AirError::locked);
    auto mask = lock.mask & 0x3FFu;
    auto next = (locks_ & ~mask) | (lock.action & mask);
    // Where the permanent bit is set, neither bit of the pair changes any more; one such pair refuses all.
    for (unsigned shift = 0; shift < 10; shift += 2) {
        bool fixed = (locks_ >> shift & permanent) != 0;
        if (fixed && ((next ^ locks_) >> shift & 3u) != 0) return tl::unexpected(AirError::locked);
    }
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    locks_ = static_cast<std::uint16_t>(next);
    return {};
}

// The command exists in the secured state alone, and for no bank but user memory.
AirResult<void> Gen2Memory::may_permalock(Bank bank, std::uint32_t first, std::uint32_t password) const {
    if (access(password) != Access::secured) return tl::unexpected(AirError::locked);
    if (bank != Bank::user) return tl::unexpected(AirError::unsupported);
    if (first >= permalocked_.size()) return tl::unexpected(AirError::bad_address);
    return {};
}

AirResult<void> Gen2Memory::permalock(Bank bank, std::uint32_t first, ByteView mask, std::uint32_t password) {
    if (auto fine = may_permalock(bank, first, password); !fine) return fine;
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < mask.size() * 8; ++i) {
        if ((mask[i / 8] >> (7 - i % 8) & 1u) == 0) continue;
        if (i >= permalocked_.size() - first) return tl::unexpected(AirError::bad_address);
        chosen.push_back(first + i);
    }
    if (!can_store()) return tl::unexpected(AirError::insufficient_power);
    for (auto block : chosen)
        permalocked_[block] = true;
    return {};
}

AirResult<Bytes> Gen2Memory::permalocked(Bank bank, std::uint32_t first, std::uint32_t bytes,
                                         std::uint32_t password) const {
    if (auto fine = may_permalock(bank, first, password); !fine) return tl::unexpected(fine.error());
    Bytes mask(bytes);
    for (std::size_t i = 0; i < mask.size() * 8 && i < permalocked_.size() - first; ++i)
        if (permalocked_[first + i]) mask[i / 8] = static_cast<std::uint8_t>(mask[i / 8] | 0x80u >> i % 8);
    return mask;
}

AirResult<void> Gen2Memory::kill(std::uint32_t kill_password) {
    return kill_if(password_at(kill_password_word), kill_password);
}

}  // namespace gantry::field
