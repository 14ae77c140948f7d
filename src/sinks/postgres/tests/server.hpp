#pragma once
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <pwd.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/log.hpp"
#include "event/event_json.hpp"
#include "sinks/postgres/postgres.hpp"
#include "testkit/eventually.hpp"
#include "testkit/process.hpp"
#include "testkit/sink_suite.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::sinks::postgres::tests {

using namespace std::chrono_literals;
using testkit::eventually;
using testkit::patience;

inline std::string program(const std::string& name) {
    std::filesystem::path newest;
    for (auto& version : std::filesystem::directory_iterator("/usr/lib/postgresql"))
        if (newest.empty() || version.path() > newest) newest = version.path();
    return newest / "bin" / name;
}

// PostgreSQL refuses to run as root.
inline std::vector<std::string> as_postgres(std::vector<std::string> arguments) {
    if (geteuid() != 0) return arguments;
    std::vector<std::string> all = {"/usr/bin/setpriv", "--reuid=postgres", "--regid=postgres",
                                    "--clear-groups"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return all;
}
inline void give_to_postgres(const std::string& path) {
    if (geteuid() != 0) return;
    const auto* user = getpwnam("postgres");
    std::vector<std::filesystem::path> all = {path};
    for (auto& each : std::filesystem::recursive_directory_iterator(path))
        all.push_back(each.path());
    for (auto& each : all)
        if (chown(each.c_str(), user->pw_uid, user->pw_gid) != 0) throw std::runtime_error("chown " + path);
}

// A data directory takes a second to make and a fifth of one to copy, so one lies beside the test programs.
inline std::filesystem::path data_template() {
    auto place = std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path();
    auto made = place / "postgres-template";
    int lock = ::open((made.string() + ".lock").c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0600);
    if (lock < 0 || flock(lock, LOCK_EX) != 0) throw std::runtime_error("no lock in " + place.string());
    if (!exists(made / "PG_VERSION")) {
        testkit::TempDir dir;
        give_to_postgres(dir.path());
        auto data = dir.path() + "/data";
        auto run = [](std::vector<std::string> arguments) {
            arguments[0] = program(arguments[0]);
            testkit::Process process(as_postgres(std::move(arguments)));
            if (process.wait() != 0) throw std::runtime_error("no data directory could be made");
        };
        run({"initdb", "-D", data, "-N", "-A", "trust", "-U", "postgres", "--locale=C", "-E", "UTF8",
             "--wal-segsize=1"});
        run({"pg_resetwal", "-D", data});  // less to copy
        for (const auto* database :
             {"1", "4"})  // template1 and template0, two thirds of all: nobody looks at them
            std::filesystem::remove_all(data + "/base/" + database);
        remove_all(made);
        std::filesystem::copy(data, made.string() + ".new", std::filesystem::copy_options::recursive);
        rename(made.string() + ".new", made);
    }
    ::close(lock);
    return made;
}

// Not out of the range from which the kernel gives away ports: the server comes back to its own.
inline std::uint16_t unused_port() {
    static int next = 20000 + getpid() * 7 % 10000;
    for (;;) {
        auto port = static_cast<std::uint16_t>(next++);
        int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(port);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        bool fine = ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
        ::close(fd);
        if (fine) return port;
    }
}

// It does not sync (a killed process loses nothing by that). Its superuser is trusted; the user gantry, who
// may make schemas, has the password "se'cret".
class Server {
public:
    explicit Server(std::vector<std::string> settings = {}) : settings_(std::move(settings)) {
        std::filesystem::copy(data_template(), data(), std::filesystem::copy_options::recursive);
        testkit::write_file(
            data() + "/pg_hba.conf",
            "host all postgres 127.0.0.1/32 trust\nhost all all 127.0.0.1/32 scram-sha-256\n");
        std::filesystem::permissions(data(), std::filesystem::perms::owner_all);
        give_to_postgres(dir_.path());
    }

    void start() {
        start_as_standby();
        if (std::exchange(made_user_, true)) return;
        sql("CREATE ROLE gantry LOGIN PASSWORD 'se''cret'; GRANT CREATE ON DATABASE postgres TO gantry");
    }
    // Nothing is written into it, which is all that one with a file standby.signal can bear.
    void start_as_standby() {
        std::vector<std::string> arguments = {program("postgres"), "-D", data(), "-p", std::to_string(port)};
        for (const auto* setting : {"listen_addresses=127.0.0.1", "unix_socket_directories=",
                                    "shared_buffers=2MB", "autovacuum=off", "fsync=off"})
            arguments.insert(arguments.end(), {"-c", setting});
        for (auto& setting : settings_)
            arguments.insert(arguments.end(), {"-c", setting});
        // What a killed server leaves behind may need a moment to end.
        bool up = eventually([&] {
            if (!process_ || !process_->running())
                process_ = std::make_unique<testkit::Process>(
                    as_postgres(arguments), std::vector<std::string>{}, dir_.path() + "/log");
            return connect(admin_);
        });
        if (!up) throw std::runtime_error("the server does not start");
    }
    // With all its processes: one that is left would end its transaction first.
    void kill() {
        auto sessions = sql("SELECT pid FROM pg_stat_activity");
        process_->signal(SIGKILL);
        process_->wait();
        for (auto& row : sessions)
            ::kill(std::stoi(row[0].value()), SIGKILL);
        admin_.close();
    }

    bool connect(Session& session) const {
        Parameters parameters = {{"hostaddr", "127.0.0.1"}, {"port", std::to_string(port)},
                                 {"user", "postgres"},      {"dbname", "postgres"},
                                 {"sslmode", "disable"},    {"options", "-c timezone=UTC"}};
        return session.connect(parameters, patience(20s)).has_value();
    }
    // As superuser. A failure fails the test.
    Rows sql(const std::string& text) {
        auto rows = admin_.run(text, patience(20s));
        if (rows) return *rows;
        ADD_FAILURE() << rows.error().text << " in: " << text;
        return {};
    }
    std::string value(const std::string& text) {
        auto rows = sql(text);
        return rows.empty() ? "no row" : rows[0][0].value_or("NULL");
    }
    // "postgres://gantry@127.0.0.1:PORT/postgres"
    std::string url(const std::string& user = "gantry") const {
        return fmt::format("postgres://{}@127.0.0.1:{}/postgres", user, port);
    }
    // How many sessions wait for a lock.
    bool waits(int sessions = 1) {
        return value("SELECT count(*) >= " + std::to_string(sessions) + " FROM pg_locks WHERE NOT granted") ==
               "t";
    }
    std::string log() { return log_.take(); }  // of ours, not of the server
    const std::string& dir() const { return dir_.path(); }
    std::string data() const { return dir_.path() + "/data"; }

    const std::uint16_t port = unused_port();

private:
    log::Capture log_;
    testkit::TempDir dir_;
    std::vector<std::string> settings_;
    std::unique_ptr<testkit::Process> process_;
    Session admin_;
    bool made_user_ = false;
};

using Given = std::vector<std::pair<std::string, std::string>>;

inline Result<std::unique_ptr<sink::Sink>> make_sink(const std::string& url, Given given = {},
                                                     const std::string& gateway = "suite") {
    static testkit::QuietHost host;
    if (std::ranges::find(given, "password", &Given::value_type::first) == given.end())
        given.emplace_back("password", "se'cret");
    auto settings = Settings::make(kind.settings, given);
    if (!settings) return tl::unexpected(settings.error());
    return kind.make({.name = "db", .gateway_id = gateway, .url = url, .settings = *settings, .batch = 1000},
                     host);
}
inline std::unique_ptr<sink::Sink> sink_of(const Server& server, Given given = {}) {
    auto made = make_sink(server.url(), std::move(given));
    if (!made) throw std::runtime_error(made.error().text());
    return std::move(*made);
}

// Events as a test wants them, "suite:1", "suite:2" … unless their seq is set.
class Lent {
public:
    event::Event& add(event::Type type) {
        auto& event = *events_.emplace_back(std::make_unique<event::Event>());
        event.seq = events_.size();
        event.type = type;
        event.time = from_us(1'795'000'000'000'001);
        return event;
    }
    std::span<const sink::Item> items(const std::string& prefix = "suite:") {
        ids_.clear();
        payloads_.clear();
        items_.clear();
        for (auto& event : events_) {
            ids_.push_back(prefix + std::to_string(event->seq));
            event::append_json(payloads_.emplace_back(), *event, prefix);
        }
        for (std::size_t i = 0; i < events_.size(); ++i)
            items_.push_back({events_[i].get(), ids_[i], payloads_[i]});
        return items_;
    }

private:
    std::vector<std::unique_ptr<event::Event>> events_;
    std::vector<std::string> ids_, payloads_;
    std::vector<sink::Item> items_;
};

inline std::ptrdiff_t count(const sink::Outcome& outcome, sink::Fate fate) {
    return std::ranges::count(outcome.fates, fate);
}
inline void expect_all_accepted(const sink::Outcome& outcome) {
    EXPECT_EQ(outcome.trouble, "");
    EXPECT_EQ(count(outcome, sink::Fate::accepted), static_cast<std::ptrdiff_t>(outcome.fates.size()));
}
inline void expect_all_kept(const sink::Outcome& outcome, std::string_view trouble) {
    EXPECT_EQ(count(outcome, sink::Fate::kept), static_cast<std::ptrdiff_t>(outcome.fates.size()));
    EXPECT_NE(outcome.trouble.find(trouble), std::string::npos) << outcome.trouble;
}

}  // namespace gantry::sinks::postgres::tests
