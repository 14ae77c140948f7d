#include <libpq-fe.h>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"

namespace gantry::bench {

namespace {
// COPY straight into a table with the columns and indexes of the sink's, a transaction a batch. A repeated id
// would end it: a client that must drop doubles cannot do this.
class BarePostgres final : public BareClient {
public:
    explicit BarePostgres(const std::string& url) : connection_(PQconnectdb(url.c_str())) {
        if (PQstatus(connection_) != CONNECTION_OK)
            throw Failure(fmt::format("bare postgres: {}", PQerrorMessage(connection_)));
        run("CREATE TABLE bare_events(LIKE gantry.events INCLUDING ALL)");
    }
    ~BarePostgres() override { PQfinish(connection_); }

    void deliver(std::span<const sink::Item> batch) override {
        run("BEGIN");
        run("COPY bare_events(schema, id, seq, type, time, reader, antenna, zone, technology, tag, epc, gs1, "
            "link, "
            "rssi_dbm, reads, first_seen, last_seen) FROM STDIN",
            PGRES_COPY_IN);
        rows_.clear();
        for (auto& item : batch) {
            auto& event = *item.event;
            auto time = to_rfc3339(event.time);
            fmt::format_to(std::back_inserter(rows_),
                           "1\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\n", item.id,
                           event.seq, event::to_text(event.type), time, event.reader, event.antenna,
                           event.zone, event::to_text(event.technology), to_hex(event.tag.view()), event.epc,
                           event.gs1, event.link, event.rssi.value_or(0) / 10.0, event.reads, time, time);
        }
        if (PQputCopyData(connection_, rows_.data(), static_cast<int>(rows_.size())) != 1 ||
            PQputCopyEnd(connection_, nullptr) != 1)
            throw Failure(fmt::format("bare postgres: {}", PQerrorMessage(connection_)));
        while (auto* result = PQgetResult(connection_)) {
            bool fine = PQresultStatus(result) == PGRES_COMMAND_OK;
            PQclear(result);
            if (!fine) throw Failure(fmt::format("bare postgres: {}", PQerrorMessage(connection_)));
        }
        run("COMMIT");
    }

private:
    void run(const char* sql, ExecStatusType wanted = PGRES_COMMAND_OK) {
        auto* result = PQexec(connection_, sql);
        bool fine = PQresultStatus(result) == wanted;
        PQclear(result);
        if (!fine) throw Failure(fmt::format("bare postgres: {}: {}", sql, PQerrorMessage(connection_)));
    }

    PGconn* connection_;
    std::string rows_;
};
}  // namespace

std::unique_ptr<BareClient> bare_postgres(const std::string& place) {
    return std::make_unique<BarePostgres>(place);
}

}  // namespace gantry::bench
