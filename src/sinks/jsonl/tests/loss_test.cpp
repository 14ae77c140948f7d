#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <set>

#include "jsonl_testing.hpp"

// What the disk is asked to do, counted and failed on request: these stand before those of the C library.
namespace {
std::atomic<int> file_syncs{0}, directory_syncs{0}, failing_syncs{0};
}
extern "C" int fdatasync(int fd) {
    ++file_syncs;
    if (failing_syncs > 0) {
        --failing_syncs;
        errno = EIO;
        return -1;
    }
    return static_cast<int>(::syscall(SYS_fdatasync, fd));
}
extern "C" int fsync(int fd) {
    struct stat about {};
    if (::fstat(fd, &about) == 0 && S_ISDIR(about.st_mode)) ++directory_syncs;
    return static_cast<int>(::syscall(SYS_fsync, fd));
}

namespace gantry::sinks::jsonl {
namespace {

using testkit::LentEvents;
using testkit::patience;
using testkit::TempDir;

TEST(JsonlLosses, NothingIsAcceptedBeforeFileAndDirectoryAreOnDisk) {
    TempDir temp;
    auto sink = make_jsonl(temp.path(), {{"rotate_size", "1KiB"}});
    for (std::uint64_t batch = 0; batch < 3; ++batch) {
        int files = file_syncs, directories = directory_syncs;
        expect_accepted(sink->deliver(LentEvents(10, 1 + batch * 10).items(), patience(20s)), 10);
        EXPECT_EQ(file_syncs, files + 1);
        EXPECT_EQ(directory_syncs, directories + 1) << "each batch fills a file, so each has a new name";
    }
    int directories = directory_syncs;
    auto again = make_jsonl(temp.path());
    expect_kept(again->deliver(LentEvents(1, 31).items(), patience(20s)), 1, "another program");
    sink.reset();
    expect_accepted(again->deliver(LentEvents(1, 31).items(), patience(20s)), 1);
    EXPECT_EQ(directory_syncs, directories + 1) << "the one before may have died before it came to that";
}

TEST(JsonlLosses, ADiskThatFailsToSyncIsNotAskedTwice) {
    TempDir temp;
    auto sink = make_jsonl(temp.path());
    expect_accepted(sink->deliver(LentEvents(10).items(), patience(20s)), 10);
    failing_syncs = 1;
    int before = file_syncs;
    expect_kept(sink->deliver(LentEvents(10, 11).items(), patience(20s)), 10, "Input/output error");
    EXPECT_EQ(file_syncs, before + 1);
    EXPECT_FALSE(sink->connected());
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 10)) << "what was not confirmed is cut off";
    expect_accepted(sink->deliver(LentEvents(10, 11).items(), patience(20s)), 10);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 20));
}

// The system lets files grow to so many bytes: writes beyond are done in part, then fail.
class FileSizeLimit {
public:
    explicit FileSizeLimit(rlim_t bytes) {
        std::signal(SIGXFSZ, SIG_IGN);
        ::getrlimit(RLIMIT_FSIZE, &before_);
        rlimit now{bytes, before_.rlim_max};
        EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &now), 0);
    }
    FileSizeLimit(const FileSizeLimit&) = delete;
    FileSizeLimit& operator=(const FileSizeLimit&) = delete;
    ~FileSizeLimit() { ::setrlimit(RLIMIT_FSIZE, &before_); }

private:
    rlimit before_{};
};

TEST(JsonlLosses, AWriteThatWasDoneInPartIsUndone) {
    TempDir temp;
    auto sink = make_jsonl(temp.path());
    expect_accepted(sink->deliver(LentEvents(10).items(), patience(20s)), 10);
    auto size = std::filesystem::file_size(temp.path() + "/archive-00000001.jsonl");
    for (rlim_t more : {1u, 100u, 3000u}) {
        FileSizeLimit limit(size + more);
        expect_kept(sink->deliver(LentEvents(10, 11).items(), patience(20s)), 10, "cannot write to");
        EXPECT_EQ(std::filesystem::file_size(temp.path() + "/archive-00000001.jsonl"), size);
    }
    expect_accepted(sink->deliver(LentEvents(10, 11).items(), patience(20s)), 10);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, 20)) << "once each, in order";
}

TEST(JsonlLosses, AFullDiskIsWaitedFor) {
    TempDir temp;
    if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        ::mount("tmpfs", temp.path().c_str(), "tmpfs", 0, "size=256k") != 0)
        GTEST_SKIP() << "this user cannot mount a small disk";
    auto sink = make_jsonl(temp.path(), {{"rotate_size", "64KiB"}});
    std::uint64_t done = 0;
    sink::Outcome outcome;
    while (outcome.trouble.empty() && done < 10'000) {
        outcome = sink->deliver(LentEvents(50, 1 + done).items(), patience(20s));
        if (outcome.trouble.empty()) done += 50;
    }
    expect_kept(outcome, 50, "No space left on device");
    EXPECT_NE(outcome.trouble.find("goes on by itself"), std::string::npos);
    ASSERT_GT(done, 100u);
    EXPECT_EQ(ids_in(temp.path()), ids_between(1, done));
    expect_kept(sink->deliver(LentEvents(50, 1 + done).items(), patience(20s)), 50, "No space left");
    std::filesystem::remove(temp.path() + "/archive-00000001.jsonl");
    auto first = ids_in(temp.path()).front();
    expect_accepted(sink->deliver(LentEvents(50, 1 + done).items(), patience(20s)), 50);
    auto held = ids_in(temp.path());
    EXPECT_EQ(held.front(), first);
    EXPECT_EQ(held.back(), ids_between(done + 50, done + 50).front());
    EXPECT_EQ(std::set<std::string>(held.begin(), held.end()).size(), held.size()) << "no doubles";
    sink.reset();
    ::umount(temp.path().c_str());
}

TEST(JsonlLosses, WhatWasAcceptedIsThereWheneverTheWriterIsKilled) {
    TempDir temp;
    std::uint64_t accepted = 0;
    for (int round = 0; round < 12; ++round) {
        int report[2];
        ASSERT_EQ(::pipe(report), 0);
        auto child = ::fork();
        if (child == 0) {
            auto sink = make_jsonl(temp.path(), {{"rotate_size", "300KiB"}});
            for (auto next = accepted + 1;; next += 300) {
                auto outcome = sink->deliver(LentEvents(300, next).items(), patience(20s));
                auto last = outcome.trouble.empty() ? next + 299 : 0;
                if (::write(report[1], &last, sizeof last) != sizeof last || last == 0) ::_exit(1);
            }
        }
        ::close(report[1]);
        std::uint64_t last = 0;
        for (int i = 0; i < 2 + round; ++i) {
            ASSERT_EQ(::read(report[0], &last, sizeof last), static_cast<ssize_t>(sizeof last));
            ASSERT_NE(last, 0u);
        }
        ::kill(child, SIGKILL);
        int status = 0;
        ::waitpid(child, &status, 0);
        EXPECT_TRUE(WIFSIGNALED(status));
        while (::read(report[0], &last, sizeof last) == sizeof last) {
        }
        ::close(report[0]);
        accepted = last;
    }
    auto sink = make_jsonl(temp.path());
    expect_accepted(sink->deliver({}, patience(20s)), 0);
    auto held = ids_in(temp.path());
    std::set<std::string> all(held.begin(), held.end());
    for (auto& id : ids_between(1, accepted))
        ASSERT_TRUE(all.contains(id)) << id << " was accepted and is not there";
}

}  // namespace
}  // namespace gantry::sinks::jsonl
