// The gateway's links: readers that dial in, readers that it dials, and the second links on which those dial
// in with notifications.
#include <algorithm>

#include <fmt/format.h>

#include "base/log.hpp"
#include "gateway/gateway.hpp"

namespace gantry::gateway {

namespace {
// Connections that have not said who they are. A newcomer beyond this displaces the oldest silent one, so
// strangers that say nothing cannot keep a reader out.
constexpr std::size_t max_unnamed = 1024;
constexpr std::size_t max_connections = 20'000;
// A link that lasted so long was of use: it may be opened anew at once, whoever ended it. A reader that takes
// the connection, answers and hangs up is waited for as one that is off.
constexpr auto of_use = 30s;

std::unique_ptr<Driver> make_driver(const ReaderConfig& section, std::string name, std::string notify_at) {
    return section.address.plugin->make_driver({.settings = section.settings,
                                                .name = std::move(name),
                                                .model = section.model,
                                                .notify_at = std::move(notify_at),
                                                .link = section.address.scheme->kind});
}
}  // namespace

Result<void> Gateway::listen() {
    for (auto& section : config_.readers) {
        if (section.address.scheme->kind != LinkKind::listen) continue;
        auto same = std::ranges::find_if(ports_, [&](auto& port) {
            auto& other = port->sections.front()->address;
            return other.scheme == section.address.scheme && other.host == section.address.host &&
                   other.port == section.address.port && other.port != 0;
        });
        if (same == ports_.end()) {
            ports_.emplace_back(std::make_unique<Port>())->sections.push_back(&section);
            continue;
        }
        // A connection needs its settings before its reader has said which section it falls under.
        const auto& first = *(*same)->sections.front();
        if (section.settings != first.settings || section.model != first.model)
            return fail(
                fmt::format("readers {} and {} dial in at one port with different settings of their make",
                            first.name, section.name),
                "give them the same settings there, or a port of their own each");
        (*same)->sections.push_back(&section);
    }
    for (auto& port : ports_)
        if (auto listening = listen_at(*port); !listening) return listening;
    return {};
}

Result<void> Gateway::listen_at(Port& port) {
    auto& section = *port.sections.front();
    Result<std::unique_ptr<link::Listener>> opened;
    loops_.front()->loop->run_and_wait([&] {
        opened =
            link::Listener::open(*loops_.front()->loop, {section.address.host, section.address.port},
                                 [this, &port](link::Socket socket) { accepted(port, std::move(socket)); });
        if (!opened) return;
        port.listener = std::move(*opened);
        port.local = port.listener->local();
    });
    if (!opened)
        return fail(fmt::format("reader {}: {}", section.name, opened.error().what), opened.error().hint);
    return {};
}

void Gateway::accepted(Port& port, link::Socket socket) {
    // On the first loop, which accepts for all.
    std::shared_ptr<Session> session;
    LoopState* loop = nullptr;
    std::shared_ptr<Session> displaced;
    {
        std::lock_guard lock(mutex_);
        if (stopping_) return;
        if (port.connections >= max_connections) {
            ++port.refused;
            return;
        }
        // All sections of a port speak one protocol; the settings of the first serve until the reader has a
        // name.
        auto& section = *port.sections.front();
        loop = loops_[next_loop_++ % loops_.size()].get();
        session = std::make_shared<Session>(next_session_++, *loop->loop, *loop->channel, *this,
                                            make_driver(section, {}, {}));
        port_of_[session->id()] = &port;
        ++port.connections;
        std::erase_if(port.unnamed, [](auto& each) {
            auto alive = each.lock();
            return !alive || alive->identified() || alive->over();
        });
        if (port.unnamed.size() >= max_unnamed) {
            displaced = port.unnamed.front().lock();
            port.unnamed.erase(port.unnamed.begin());
            ++port.displaced;
        }
        port.unnamed.push_back(session);
    }
    if (displaced)
        displaced->loop().post([displaced] { displaced->close("made room: it did not say who it is"); });
    auto shared_socket = std::make_shared<link::Socket>(std::move(socket));
    loop->loop->post([loop, session, shared_socket] {
        loop->sessions.emplace(session->id(), session);
        session->start(std::move(*shared_socket));
    });
}

Result<void> Gateway::listen_for_notifications() {
    std::unordered_map<std::string, NotifyPort*> by_address;
    for (auto& [index, reader] : dialled_) {
        auto& section = *reader->section;
        if (section.notify.empty()) continue;
        auto endpoint = link::parse_endpoint(section.notify);
        if (!endpoint)
            return fail(fmt::format("reader {}: {}", section.name, endpoint.error().what),
                        endpoint.error().hint);
        auto same = by_address.find(link::to_text(*endpoint));
        if (same != by_address.end() && endpoint->port != 0) {
            same->second->readers.push_back(reader->entry);
            reader->notify = same->second;
            continue;
        }
        auto& port = *notify_ports_.emplace_back(std::make_unique<NotifyPort>());
        by_address[link::to_text(*endpoint)] = &port;
        port.readers.push_back(reader->entry);
        reader->notify = &port;
        Result<std::unique_ptr<link::Listener>> opened;
        loops_.front()->loop->run_and_wait([&] {
            opened = link::Listener::open(
                *loops_.front()->loop, *endpoint,
                [this, &port](link::Socket socket) { notified(port, std::move(socket)); });
            if (!opened) return;
            port.listener = std::move(*opened);
            port.local = port.listener->local();
        });
        if (!opened)
            return fail(fmt::format("notify of reader {}: {}", section.name, opened.error().what),
                        opened.error().hint);
    }
    return {};
}

// On the first loop. Whose notifications these are is told by the address alone: the reader at the other end
// of a link that we dialled there.
void Gateway::notified(NotifyPort& port, link::Socket socket) {
    std::vector<std::shared_ptr<Session>> found;
    {
        std::lock_guard lock(mutex_);
        if (stopping_) return;
        for (auto* entry : port.readers) {
            auto owner = owners_.find(entry->index);
            if (owner != owners_.end() && owner->second.session &&
                owner->second.session->peer_host() == socket.peer_host())
                found.push_back(owner->second.session);
        }
    }
    if (found.size() != 1) {
        ++port.refused;
        auto unsaid = port.refusals.count("notify", socket.peer_host(), link::read_clocks().steady);
        if (!unsaid) return;
        log::warn("readers", "notifications from {} at {} are refused: {}{}", socket.peer(),
                  link::to_text(port.local),
                  found.empty() ? "no reader is connected there" : "several readers are connected there",
                  *unsaid == 0 ? "" : fmt::format("; {} more times since this was last said", *unsaid));
        return;
    }
    ++port.connections;
    auto shared_socket = std::make_shared<link::Socket>(std::move(socket));
    auto session = std::move(found.front());
    session->loop().post([session, shared_socket, &port] {
        session->notified(std::move(*shared_socket), [&port] { --port.connections; });
    });
}

void Gateway::dial() {
    for (auto& [index, reader] : dialled_) {
        auto* raw = reader.get();
        raw->loop->loop->run_and_wait([this, raw] {
            raw->dialler = std::make_unique<Dialler>(
                *raw->loop->loop, *raw->section, std::hash<std::string>{}(raw->section->name),
                [this, raw](link::Socket socket) { opened(*raw, std::move(socket)); });
            raw->dialler->start();
        });
    }
}

void Gateway::opened(Dialled& reader, link::Socket socket) {
    auto& section = *reader.section;
    std::string notify_at;
    if (reader.notify != nullptr) {
        notify_at = section.advertise;
        if (notify_at.empty())
            notify_at = link::to_text(link::Endpoint{socket.local_host(), reader.notify->local.port});
    }
    SessionId id = 0;
    {
        std::lock_guard lock(mutex_);
        if (stopping_) return;
        id = next_session_++;
    }
    reader.opened = link::read_clocks().steady;
    auto session =
        std::make_shared<Session>(id, *reader.loop->loop, *reader.loop->channel, *this,
                                  make_driver(section, section.name, std::move(notify_at)), reader.entry);
    reader.loop->sessions.emplace(id, session);
    session->open(std::move(socket));
}

// Of a reader that we dial: the next link is due.
void Gateway::link_ended(Session& session) {
    auto found = dialled_.find(session.reader()->index);
    if (found == dialled_.end() || !found->second->dialler) return;
    auto age = link::read_clocks().steady - found->second->opened.value_or(Steady{});
    found->second->dialler->ended(session.was_up(), age >= of_use, session.close_reason());
}

}  // namespace gantry::gateway
