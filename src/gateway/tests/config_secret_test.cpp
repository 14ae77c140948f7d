#include "gateway/config_secret.hpp"

#include <sys/stat.h>

#include <cstdlib>

#include <gtest/gtest.h>

#include "gateway/roster.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::gateway {
namespace {

constexpr std::array rows = {
    SettingRow{.name = "power", .kind = SettingRow::Kind::number, .fallback = "1", .help = "Power."},
    SettingRow{
        .name = "password", .kind = SettingRow::Kind::hex, .fallback = "", .help = "Login.", .secret = true}};

TEST(ConfigSecret, OnlySecretsAreNamedByAFileOrTheEnvironment) {
    auto file = secret_key(rows, "password_file"), variable = secret_key(rows, "password_env");
    ASSERT_TRUE(file && variable);
    EXPECT_TRUE(file->from_file);
    EXPECT_FALSE(variable->from_file);
    EXPECT_EQ(file->row, &rows[1]);
    for (auto* other : {"password", "password_", "password_files", "power_file", "pass_env", "_file", ""})
        EXPECT_FALSE(secret_key(rows, other)) << other;
}

TEST(ConfigSecret, AFileIsReadUnlessEverybodyCan) {
    testkit::TempDir dir;
    auto path = dir.path() + "/secret";
    SecretKey key{&rows[1], true};
    auto missing = read_secret(key, path);
    ASSERT_FALSE(missing);
    EXPECT_EQ(missing.error().text(),
              "password_file: cannot read " + path +
                  ": No such file or directory; is it there, and may this user read it?");
    testkit::write_file(path, " 11223344\n");
    struct Row {
        unsigned mode;
        bool fine;
    };
    for (auto& row :
         {Row{0600, true}, Row{0640, true}, Row{0644, false}, Row{0604, false}, Row{0400, true}}) {
        ::chmod(path.c_str(), row.mode);
        auto secret = read_secret(key, path);
        ASSERT_EQ(secret.has_value(), row.fine) << row.mode;
        if (row.fine)
            EXPECT_EQ(*secret, "11223344") << "without the white space around it";
        else
            EXPECT_EQ(secret.error().text(),
                      "password_file: everybody can read " + path + "; chmod 640 " + path);
    }
    ::chmod(path.c_str(), 0600);
    for (auto& text : {std::string(" \n"), std::string(5000, 'A')}) {
        testkit::write_file(path, text);
        ::chmod(path.c_str(), 0600);
        auto secret = read_secret(key, path);
        ASSERT_FALSE(secret);
        EXPECT_EQ(secret.error().text().find("AAAA"), std::string::npos) << "it is never shown";
    }
}

TEST(ConfigSecret, AVariableOfTheEnvironmentHoldsIt) {
    SecretKey key{&rows[1], false};
    constexpr auto* name = "GANTRY_CONFIG_SECRET_TEST";
    ::unsetenv(name);
    auto missing = read_secret(key, name);
    ASSERT_FALSE(missing);
    EXPECT_NE(missing.error().text().find("password_env: there is no GANTRY_CONFIG_SECRET_TEST"),
              std::string::npos);
    ::setenv(name, "AABBCCDD ", 1);
    EXPECT_EQ(read_secret(key, name).value_or("-"), "AABBCCDD");
    ::setenv(name, "", 1);
    EXPECT_FALSE(read_secret(key, name));
    ::unsetenv(name);
}

TEST(Roster, AReaderWithoutANameIsFoundByItsAddress) {
    ReaderConfig any, dock, gates;
    any.name = "any-*";
    dock.name = "dock";
    dock.from = {"192.168.0.7"};
    gates.name = "gate-*";
    gates.from = {"192.168.0.0/24", "fe80::/10"};
    std::vector<const ReaderConfig*> sections{&any, &dock, &gates};
    struct Row {
        std::string_view host;
        const ReaderConfig* section;
        std::string_view name;
    };
    std::string name, why;
    for (auto& row : {Row{"192.168.0.7", &dock, "dock"}, Row{"192.168.0.8", &gates, "gate-192.168.0.8"},
                      Row{"fe80::1", &gates, "gate-fe80::1"}, Row{"10.0.0.1", &any, "any-10.0.0.1"}}) {
        EXPECT_EQ(section_at(sections, row.host, name, why), row.section) << row.host;
        EXPECT_EQ(name, row.name);
        EXPECT_EQ(why, "");
    }
    sections.erase(sections.begin());
    EXPECT_EQ(section_at(sections, "10.0.0.1", name, why), nullptr);
    EXPECT_EQ(why, "its address 10.0.0.1 is in no section's `from`");
}

}  // namespace
}  // namespace gantry::gateway
