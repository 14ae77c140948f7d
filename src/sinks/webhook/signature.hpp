#pragma once
#include <span>
#include <string>
#include <string_view>

#include "sink/sink.hpp"

// What a receiver tells us, and a repeat, by. signature.cpp alone knows OpenSSL.
namespace gantry::sinks::webhook {

// The value of Gantry-Signature, "t=1795000000,v1=<hex>": HMAC-SHA256 with `secret` over the seconds since
// 1970 as they stand there, a dot, and the body as it is sent.
std::string signature(std::string_view secret, std::int64_t seconds, std::string_view body);

// The value of Idempotency-Key: the first and the last id, and a hash over all. The same items have the same
// key for ever, and no others do.
std::string idempotency_key(std::span<const sink::Item> items);

std::string base64(std::string_view text);

}  // namespace gantry::sinks::webhook
