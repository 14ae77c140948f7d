#include "journal/sqlite.hpp"
#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {

JobRow job(std::uint64_t id, std::string state, Wall created = start_time) {
    JobRow row;
    row.id = id;
    row.reader = "dock-1";
    row.op = "tag.write";
    row.detail = "tag E2, user 0 to 1";
    row.state = std::move(state);
    row.created = created;
    row.deadline = created + 10s;
    if (row.state == "done") row.ended = created + 1s;
    return row;
}

std::vector<JobRow> jobs_of(Journal& journal) {
    std::vector<JobRow> out;
    EXPECT_TRUE(journal.load_jobs([&](JobRow row) { out.push_back(std::move(row)); }));
    return out;
}

void store_jobs(Journal& journal, std::vector<JobRow> rows) {
    auto batch = next_batch(journal);
    batch.jobs = std::move(rows);
    EXPECT_FALSE(batch.empty());
    ASSERT_TRUE(journal.commit(batch));
    EXPECT_TRUE(batch.empty());
}

TEST(JournalJobs, ComeBackAsTheyWereLastStored) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        store_jobs(*journal, {job(1, "queued"), job(2, "running")});
        auto ended = job(1, "done");
        ended.text = "it \"said\" so";
        store_jobs(*journal, {job(1, "running"), ended});
    }
    auto jobs = jobs_of(*open_store(folder.store()));
    ASSERT_EQ(jobs.size(), 2u);
    EXPECT_EQ(jobs[0].id, 1u);
    EXPECT_EQ(jobs[0].state, "done");
    EXPECT_EQ(jobs[0].text, "it \"said\" so");
    EXPECT_EQ(jobs[0].reader, "dock-1");
    EXPECT_EQ(jobs[0].op, "tag.write");
    EXPECT_EQ(jobs[0].detail, "tag E2, user 0 to 1");
    EXPECT_EQ(jobs[0].created, start_time);
    EXPECT_EQ(jobs[0].deadline, start_time + 10s);
    EXPECT_EQ(jobs[0].ended, start_time + 1s);
    EXPECT_EQ(jobs[1].state, "running");
    EXPECT_EQ(jobs[1].ended, std::nullopt);
}

TEST(JournalJobs, ThatHaveEndedGoByAgeButNeverTheNewestNorAnOpenOne) {
    Folder folder;
    Options options;
    options.path = folder.store();
    options.keep = 1h;
    auto journal = open_store(options);
    store_jobs(*journal,
               {job(1, "done"), job(2, "queued"), job(3, "done", start_time + 90min), job(4, "done")});
    ASSERT_TRUE(journal->retain(start_time + 2h));
    std::vector<std::uint64_t> left;
    for (auto& row : jobs_of(*journal))
        left.push_back(row.id);
    EXPECT_EQ(left, (std::vector<std::uint64_t>{2, 3, 4})) << "the newest keeps the count of numbers";
}

TEST(JournalJobs, AreBoundedInNumber) {
    Folder folder;
    auto journal = open_store(folder.store());
    std::vector<JobRow> rows;
    for (std::uint64_t id = 1; id <= max_jobs + 100; ++id)
        rows.push_back(job(id, id == 5 ? "running" : "done"));
    store_jobs(*journal, std::move(rows));
    ASSERT_TRUE(journal->retain(start_time));
    auto left = jobs_of(*journal);
    EXPECT_EQ(left.size(), max_jobs + 1);
    EXPECT_EQ(left.front().id, 5u);
    EXPECT_EQ(left.back().id, max_jobs + 100);
}

TEST(JournalJobs, ADamagedRowIsAJobOfUnknownEnd) {
    Folder folder;
    store_jobs(*open_store(folder.store()), {job(1, "done"), job(2, "done")});
    auto db = Database::open(folder.store(), Database::Access::write);
    ASSERT_TRUE(db);
    ASSERT_TRUE(db->run("UPDATE jobs SET detail = 'something else' WHERE id = 1"));
    auto jobs = jobs_of(*open_store(folder.store()));
    ASSERT_EQ(jobs.size(), 2u);
    EXPECT_EQ(jobs[0].state, "unknown");
    EXPECT_EQ(jobs[0].text, "its row in the store is damaged");
    EXPECT_EQ(jobs[0].ended, std::nullopt) << "whoever loads it says when, and stores it";
    EXPECT_EQ(jobs[1].state, "done");
}

TEST(JournalJobs, StoppedReadersAreThoseLastSaidToBe) {
    Folder folder;
    {
        auto journal = open_store(folder.store());
        auto batch = next_batch(*journal);
        batch.reading = {{"a", false}, {"b", false}, {"c", true}, {"a", true}};
        ASSERT_TRUE(journal->commit(batch));
    }
    EXPECT_EQ(open_store(folder.store())->stopped_readers(), std::vector<std::string>{"b"});
}

}  // namespace
}  // namespace gantry::journal::tests
