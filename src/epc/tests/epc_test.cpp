#include "epc/epc.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "epc/scheme.hpp"
#include "testkit/vectors.hpp"

namespace gantry::epc {

using testkit::hex;

static std::string refusal(std::string_view bytes) {
    auto epc = decode(hex(bytes));
    return epc ? "decoded as " + epc->tag_uri : epc.error().what;
}

struct Example {
    std::string_view bytes, tag_uri, uri, gs1, link;
};

// TDS 2.3 annex E.3, and values published by other decoders of the standard.
static const Example examples[] = {
    {"3066C4409047E140075BCD15", "urn:epc:tag:sgtin-96:3.95060001343.05.123456789",
     "urn:epc:id:sgtin:95060001343.05.123456789", "(01)09506000134352(21)123456789",
     "https://id.gs1.org/01/09506000134352/21/123456789"},
    {"3074257BF7194E4000001A85", "urn:epc:tag:sgtin-96:3.0614141.812345.6789",
     "urn:epc:id:sgtin:0614141.812345.6789", "(01)80614141123458(21)6789",
     "https://id.gs1.org/01/80614141123458/21/6789"},
    {"30340242201D8840009EFDF7", "urn:epc:tag:sgtin-96:1.0037000.030241.10419703",
     "urn:epc:id:sgtin:0037000.030241.10419703", "(01)00037000302414(21)10419703",
     "https://id.gs1.org/01/00037000302414/21/10419703"},
    {"311BA1B300CE0A6A83000000", "urn:epc:tag:sscc-96:0.952012.03456789123",
     "urn:epc:id:sscc:952012.03456789123", "(00)095201234567891235",
     "https://id.gs1.org/00/095201234567891235"},
};

TEST(Epc, TheExamplesOfTheStandardDecode) {
    for (auto& example : examples) {
        SCOPED_TRACE(example.bytes);
        auto epc = decode(hex(example.bytes));
        ASSERT_TRUE(epc) << epc.error().text();
        EXPECT_EQ(epc->tag_uri, example.tag_uri);
        EXPECT_EQ(epc->uri, example.uri);
        EXPECT_EQ(epc->gs1, example.gs1);
        EXPECT_EQ(epc->link, example.link);
        EXPECT_EQ(epc->doubt, "");
    }
    EXPECT_EQ(decode(hex(examples[0].bytes))->scheme, "sgtin-96");
    EXPECT_EQ(decode(hex(examples[0].bytes))->filter, 3u);
    EXPECT_EQ(decode(hex(examples[3].bytes))->scheme, "sscc-96");
    EXPECT_EQ(decode(hex(examples[3].bytes))->filter, 0u);
}

TEST(Epc, TheExamplesOfTheStandardEncode) {
    for (auto& example : examples) {
        SCOPED_TRACE(example.bytes);
        auto whole = decode(hex(example.bytes));
        ASSERT_TRUE(whole);
        auto prefix_digits = static_cast<unsigned>(example.uri.find('.') - example.uri.rfind(':') - 1);
        EXPECT_EQ(encode(example.tag_uri), hex(example.bytes));
        EXPECT_EQ(encode(example.uri, whole->filter), hex(example.bytes));
        EXPECT_EQ(encode(example.gs1, whole->filter, prefix_digits), hex(example.bytes));
    }
}

TEST(Epc, AnIdUriWithoutAFilterGetsFilterZero) {
    auto bytes = encode("urn:epc:id:sgtin:0614141.812345.6789");
    ASSERT_TRUE(bytes);
    EXPECT_EQ(decode(*bytes)->tag_uri, "urn:epc:tag:sgtin-96:0.0614141.812345.6789");
}

TEST(Epc, ACheckDigitOfASumThatIsAMultipleOfTenIsZero) {
    auto epc = decode(hex("3036142C8C008F8000053244"));
    ASSERT_TRUE(epc);
    EXPECT_EQ(epc->gs1, "(01)08719139005740(21)340548");
}

TEST(Epc, PartitionZeroHasAReferenceOfOneDigit) {
    auto epc = decode(hex("3000E2009A9040060AF00000"));
    ASSERT_TRUE(epc);
    EXPECT_EQ(epc->tag_uri, "urn:epc:tag:sgtin-96:0.242668184592.0.25953304576");
    EXPECT_EQ(epc->gs1.substr(0, 17), "(01)0242668184592");
    EXPECT_EQ(encode(epc->tag_uri), hex("3000E2009A9040060AF00000"));
}

TEST(Epc, TheIndicatorStandsBeforeThePrefixInTheKeyAndBeforeTheItemInTheUri) {
    auto bytes = encode("(01)20000010000025(21)7", 0, 7);
    ASSERT_TRUE(bytes) << bytes.error().text();
    auto epc = decode(*bytes);
    ASSERT_TRUE(epc);
    EXPECT_EQ(epc->uri, "urn:epc:id:sgtin:0000010.200002.7");
    EXPECT_EQ(epc->gs1, "(01)20000010000025(21)7");
}

TEST(Epc, ZerosOfPrefixReferenceAndKeyAreKept) {
    auto bytes = encode("urn:epc:tag:sscc-96:2.0000001.0000000000");
    ASSERT_TRUE(bytes);
    auto epc = decode(*bytes);
    ASSERT_TRUE(epc);
    EXPECT_EQ(epc->uri, "urn:epc:id:sscc:0000001.0000000000");
    EXPECT_EQ(epc->gs1, "(00)000000010000000009");
    EXPECT_EQ(encode(epc->gs1, 2, 7), *bytes);
}

TEST(Epc, APcWordInFrontIsDecodedButDoubted) {
    auto epc = decode(hex("3000E2009A9040060AF000000372"));
    ASSERT_TRUE(epc);
    EXPECT_EQ(epc->tag_uri, "urn:epc:tag:sgtin-96:0.242668184592.0.25953304576");
    EXPECT_EQ(epc->doubt, "3000 looks like a PC word before an EPC of 96 bits: leave it out");
    EXPECT_EQ(decode(hex("3000E2009A9040060AF0000003720000"))->doubt, "") << "the length does not agree";
}

TEST(Epc, SurplusBitsUpToTheWordAreIgnored) {
    EXPECT_EQ(decode(hex("3074257BF7194E4000001A85FFFF"))->uri, "urn:epc:id:sgtin:0614141.812345.6789");
}

TEST(Epc, WhatIsTooShortIsRefusedAtEveryLength) {
    auto whole = hex("3074257BF7194E4000001A85");
    for (std::size_t size = 1; size < whole.size(); ++size) {
        Bytes exact(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
        auto epc = decode(exact);
        ASSERT_FALSE(epc) << size;
        EXPECT_NE(epc.error().what.find("96 are needed"), std::string::npos) << epc.error().what;
    }
}

TEST(Epc, WhatIsNoEpcSaysWhatItIs) {
    EXPECT_EQ(refusal(""), "no bytes: the tag has no EPC");
    EXPECT_EQ(refusal("00"), "unprogrammed (header 00)");
    EXPECT_EQ(refusal("E2801160600002084D4B3A5C"), "looks like a TID, not an EPC (header E2)");
    EXPECT_EQ(refusal("FF00"), "header FF belongs to no EPC scheme");
    EXPECT_EQ(refusal("DEADBEEF"), "header DE belongs to no EPC scheme");
    EXPECT_EQ(refusal("3376451FD40C0E400000162E"), "GRAI-96: not decoded by this version");
    EXPECT_EQ(refusal("F73795211411234538566CB0AFC4"), "SGTIN+: not decoded by this version");
}

TEST(Epc, EveryHeaderGivesAnEpcOrAReason) {
    unsigned refused = 0;
    for (unsigned header = 0; header < 256; ++header) {
        Bytes bytes(12, 0);
        bytes[0] = static_cast<std::uint8_t>(header);
        auto epc = decode(bytes);
        if (epc) continue;
        ++refused;
        EXPECT_GT(epc.error().what.size(), 10u) << header;
        auto* scheme = find_header(bytes[0]);
        if (scheme != nullptr) {
            EXPECT_TRUE(epc.error().what.starts_with(scheme->title)) << epc.error().what;
        }
    }
    EXPECT_EQ(refused, 254u) << "all but SGTIN-96 and SSCC-96";
}

TEST(Epc, PartitionSevenIsRefused) {
    EXPECT_EQ(refusal("307C257BF7194E4000001A85"), "SGTIN-96: partition 7 is invalid");
    EXPECT_EQ(refusal("311FA1B300CE0A6A83000000"), "SSCC-96: partition 7 is invalid");
}

TEST(Epc, ValuesTooBigForTheirDigitsAreRefused) {
    // Twenty bits hold 1,048,575, six digits do not; four bits hold 15, one digit does not.
    EXPECT_EQ(refusal("301BFFFFC000000000000000"),
              "SGTIN-96: company prefix 1048575 does not fit into 6 digits");
    EXPECT_EQ(refusal("301400000FFFFFC000000000"),
              "SGTIN-96: indicator and item reference 1048575 does not fit into 6 digits");
    EXPECT_EQ(refusal("30000000000003C000000000"),
              "SGTIN-96: indicator and item reference 15 does not fit into 1 digit");
}

TEST(Epc, BitsThatMustBeZeroInAnSsccAreRefused) {
    EXPECT_EQ(refusal("311BA1B300CE0A6A83000001"), "SSCC-96: the last 24 bits must be zero");
}

static std::string encode_refusal(std::string_view text, std::optional<unsigned> filter = {},
                                  std::optional<unsigned> prefix_digits = {}) {
    auto bytes = encode(text, filter, prefix_digits);
    return bytes ? "encoded as " + to_hex(*bytes) : bytes.error().text();
}

TEST(Epc, WhatCannotBeEncodedSaysWhy) {
    EXPECT_EQ(
        encode_refusal("hello\x1b[2J"),
        "\"hello\\x1B[2J\" is no EPC; write urn:epc:tag:…, urn:epc:id:… or an element string (01)…(21)…");
    EXPECT_EQ(encode_refusal("urn:epc:tag:grai-96:3.9521141.12345.5678"),
              "scheme \"grai-96\" is not encoded by this version; it encodes sgtin-96, sscc-96");
    EXPECT_EQ(encode_refusal("urn:epc:id:grai:9521141.12345.5678"),
              "scheme \"grai\" is not encoded by this version; it encodes sgtin-96, sscc-96");
    EXPECT_EQ(encode_refusal("urn:epc:tag:sgtin-96"),
              "SGTIN-96: the filter before the first dot must be 0 to 7");
    EXPECT_EQ(encode_refusal("urn:epc:tag:sgtin-96:8.0614141.812345.6789"),
              "SGTIN-96: the filter before the first dot must be 0 to 7");
    EXPECT_EQ(encode_refusal("urn:epc:tag:sgtin-96:3.0614141.812345.6789", 1),
              "the tag URI says filter 3, but filter 1 was asked for");
    EXPECT_EQ(encode_refusal("urn:epc:id:sgtin:0614141.812345.6789", 8), "filter 8 is outside 0 to 7");
    EXPECT_EQ(encode_refusal("urn:epc:id:sgtin:0614141.812345"),
              "SGTIN-96: \"0614141.812345\" has 2 parts between dots, 3 are needed");
    EXPECT_EQ(encode_refusal("urn:epc:id:sscc:0614141.1234567890.1"),
              "SSCC-96: \"0614141.1234567890.1\" has 3 parts between dots, 2 are needed");
    EXPECT_EQ(encode_refusal("urn:epc:id:sgtin:06141.81234567.6789"), "a company prefix has 6 to 12 digits");
    EXPECT_EQ(encode_refusal("urn:epc:id:sgtin:061414x.812345.6789"),
              "SGTIN-96: company prefix \"061414x\" is no number");
    EXPECT_EQ(
        encode_refusal("urn:epc:id:sgtin:0614141.81234.6789"),
        "SGTIN-96: indicator and item reference \"81234\" must have 6 digits with a company prefix of 7");
    EXPECT_EQ(
        encode_refusal("urn:epc:id:sgtin:0614141.812345.32a"),
        "SGTIN-96: serial \"32a\" does not fit; it must be a number of 0 to 274877906943 with no leading "
        "zero");
    EXPECT_TRUE(encode_refusal("urn:epc:id:sgtin:0614141.812345.0678").starts_with("SGTIN-96: serial"));
    EXPECT_TRUE(encode_refusal("urn:epc:id:sgtin:0614141.812345.274877906944").starts_with("SGTIN-96: ser"));
    EXPECT_TRUE(encode_refusal("urn:epc:id:sgtin:0614141.812345.").starts_with("SGTIN-96: serial \"\""));
    EXPECT_EQ(encode_refusal("(01)80614141123459(21)6789", 3, 7),
              "(01)80614141123459: the check digit is 9, it should be 8");
    EXPECT_EQ(encode_refusal("(01)8061414112345(21)6789", 3, 7),
              "(01) must have 14 digits, not \"8061414112345\"");
    EXPECT_EQ(encode_refusal("(01)80614141123458(21)6789", 3),
              "an element string does not say how long its company prefix is; give the number of digits of "
              "the company prefix, 6 to 12");
    EXPECT_EQ(encode_refusal("(01)80614141123458(21)6789", 3, 13), "a company prefix has 6 to 12 digits");
    EXPECT_EQ(encode_refusal("(01)80614141123458", 3, 7),
              "(21) must follow (01): SGTIN-96 is one thing, not a kind of thing");
    EXPECT_EQ(encode_refusal("(01)80614141123458(21)6789(17)261231", 3, 7),
              "SGTIN-96 has no room for \"(17)261231\"");
    EXPECT_EQ(encode_refusal("(8003)0952", {}, 7),
              "(8003) is no key that this version encodes; write (01)…(21)… or (00)…");
    EXPECT_EQ(encode_refusal("(01", {}, 7),
              "(?) is no key that this version encodes; write (01)…(21)… or (00)…");
}

// Any numbers that the scheme can hold, as a tag URI.
static std::string some_tag_uri(const Scheme& scheme) {
    auto digits = [](unsigned count) {
        std::string text;
        for (unsigned i = 0; i < count; ++i)
            text += *rc::gen::inRange('0', static_cast<char>('9' + 1));
        return text;
    };
    auto partition = *rc::gen::inRange(0u, partitions);
    auto text = "urn:epc:tag:" + std::string(scheme.name) + ":" + std::to_string(*rc::gen::inRange(0, 8)) +
                "." + digits(most_prefix_digits - partition) + "." +
                digits(partition + scheme.keyed->reference_extra);
    if (scheme.keyed->serial_bits > 0)
        text += "." + std::to_string(
                          *rc::gen::inRange<std::uint64_t>(0, std::uint64_t{1} << scheme.keyed->serial_bits));
    return text;
}

RC_GTEST_PROP(Epc, EveryEpcOfADecodedSchemeGoesBothWaysInAllItsForms, ()) {
    for (auto& scheme : all_schemes()) {
        if (scheme.keyed == nullptr) continue;
        auto tag_uri = some_tag_uri(scheme);
        auto bytes = encode(tag_uri);
        RC_ASSERT(bytes.has_value());
        RC_ASSERT(bytes->size() * 8 == scheme.bits);
        auto epc = decode(*bytes);
        RC_ASSERT(epc.has_value());
        RC_ASSERT(epc->tag_uri == tag_uri);
        auto prefix_digits = static_cast<unsigned>(epc->uri.find('.') - epc->uri.rfind(':') - 1);
        RC_ASSERT(encode(epc->uri, epc->filter) == *bytes);
        RC_ASSERT(encode(epc->gs1, epc->filter, prefix_digits) == *bytes);
    }
}

RC_GTEST_PROP(Epc, WhateverDecodesEncodesBackToTheSameBytes, ()) {
    auto bytes = *rc::gen::container<Bytes>(12, rc::gen::arbitrary<std::uint8_t>());
    bytes[0] = *rc::gen::element<std::uint8_t>(0x30, 0x31);
    if (bytes[0] == 0x31) bytes[9] = bytes[10] = bytes[11] = 0;
    auto epc = decode(bytes);
    RC_PRE(epc.has_value());
    RC_ASSERT(encode(epc->tag_uri) == bytes);
}

RC_GTEST_PROP(Epc, NoTextMakesTheEncoderFailHarderThanARefusal, (const std::string& tail)) {
    for (auto* head :
         {"", "(01)", "(00)", "urn:epc:id:sgtin:", "urn:epc:tag:sscc-96:", "(01)80614141123458("}) {
        auto bytes = encode(head + tail, {}, 7);
        RC_ASSERT(bytes || !bytes.error().what.empty());
    }
}

}  // namespace gantry::epc
