#include "sinks/webhook/signature.hpp"

#include <openssl/core_names.h>
#include <openssl/evp.h>
#include <openssl/params.h>

#include <array>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/text.hpp"

namespace gantry::sinks::webhook {

static const unsigned char* raw(std::string_view text) {
    return reinterpret_cast<const unsigned char*>(text.data());
}

static void must(bool worked) {
    if (!worked) throw std::runtime_error("OpenSSL does not do SHA-256");  // no such build is in use
}

static std::string hex(std::span<const unsigned char> bytes) {
    std::string out;
    for (auto byte : bytes)
        fmt::format_to(std::back_inserter(out), "{:02x}", byte);
    return out;
}

std::string signature(std::string_view secret, std::int64_t seconds, std::string_view body) {
    auto time = std::to_string(seconds);
    std::unique_ptr<EVP_MAC, decltype(&::EVP_MAC_free)> mac(::EVP_MAC_fetch(nullptr, "HMAC", nullptr),
                                                            &::EVP_MAC_free);
    must(mac != nullptr);
    std::unique_ptr<EVP_MAC_CTX, decltype(&::EVP_MAC_CTX_free)> state(::EVP_MAC_CTX_new(mac.get()),
                                                                      &::EVP_MAC_CTX_free);
    char digest[] = "SHA256";
    std::array parameters = {OSSL_PARAM_construct_utf8_string(OSSL_MAC_PARAM_DIGEST, digest, 0),
                             OSSL_PARAM_construct_end()};
    std::array<unsigned char, 32> out{};
    std::size_t size = 0;
    must(state && ::EVP_MAC_init(state.get(), raw(secret), secret.size(), parameters.data()) == 1 &&
         ::EVP_MAC_update(state.get(), raw(time), time.size()) == 1 &&
         ::EVP_MAC_update(state.get(), raw("."), 1) == 1 &&
         ::EVP_MAC_update(state.get(), raw(body), body.size()) == 1 &&
         ::EVP_MAC_final(state.get(), out.data(), &size, out.size()) == 1);
    return fmt::format("t={},v1={}", time, hex(out));
}

std::string idempotency_key(std::span<const sink::Item> items) {
    constexpr std::size_t short_hash = 8, longest_id = 100;
    std::unique_ptr<EVP_MD_CTX, decltype(&::EVP_MD_CTX_free)> state(::EVP_MD_CTX_new(), &::EVP_MD_CTX_free);
    must(state && ::EVP_DigestInit_ex(state.get(), ::EVP_sha256(), nullptr) == 1);
    for (auto& item : items)
        must(::EVP_DigestUpdate(state.get(), item.id.data(), item.id.size()) == 1 &&
             ::EVP_DigestUpdate(state.get(), "\n", 1) == 1);
    std::array<unsigned char, 32> out{};
    must(::EVP_DigestFinal_ex(state.get(), out.data(), nullptr) == 1);
    auto fits = [](std::string_view id) { return id.size() <= longest_id && is_printable_ascii(id); };
    if (items.empty() || !fits(items.front().id) || !fits(items.back().id)) return hex(out);
    return fmt::format("{}..{}-{}", items.front().id, items.back().id, hex(std::span(out).first(short_hash)));
}

std::string base64(std::string_view text) {
    std::string out(4 * ((text.size() + 2) / 3) + 1, '\0');  // EVP writes a NUL behind it
    auto size = ::EVP_EncodeBlock(reinterpret_cast<unsigned char*>(out.data()), raw(text),
                                  static_cast<int>(text.size()));
    out.resize(static_cast<std::size_t>(size));
    return out;
}

}  // namespace gantry::sinks::webhook
