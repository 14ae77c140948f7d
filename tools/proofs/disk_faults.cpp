// Loaded before the C library (LD_PRELOAD): a disk under gantry.db that is slow, or fails at a call that is
// named from outside while the process runs. What is wanted stands in a file that both ends map,
// GANTRY_DISK_FAULTS.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace {

enum Call : std::int32_t { write_call = 1, sync_call = 2, open_call = 3 };

constexpr int calls = 4;

// The same in disk_faults.py. Each call has its own; those of no call stay empty.
struct Wanted {
    std::atomic<std::int32_t> error[calls];     // with this errno
    std::atomic<std::int32_t> before[calls];    // after so many that go well
    std::atomic<std::int32_t> failures[calls];  // so many fail; negative: all that come
    std::atomic<std::int32_t> failed[calls];    // counted here
    std::atomic<std::int32_t> made[calls];      // all there were
    std::atomic<std::int32_t> sync_us;          // how long each sync takes
};

Wanted* wanted() {
    static Wanted* const mapped = [] {
        const char* path = std::getenv("GANTRY_DISK_FAULTS");
        int file = path == nullptr ? -1 : ::openat(AT_FDCWD, path, O_RDWR | O_CLOEXEC);
        if (file < 0) return static_cast<Wanted*>(nullptr);
        void* at = ::mmap(nullptr, sizeof(Wanted), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        ::close(file);
        return at == MAP_FAILED ? nullptr : static_cast<Wanted*>(at);
    }();
    return mapped;
}

constexpr int most_files = 4096;
std::atomic<bool> of_the_store[most_files];

bool is_store(const char* path) {
    return std::strstr(path, "gantry.db") != nullptr;
}
bool is_store(int file) {
    return file >= 0 && file < most_files && of_the_store[file];
}

// True when this call is to fail; errno says how.
bool fails(Call call) {
    auto* want = wanted();
    if (want == nullptr) return false;
    ++want->made[call];
    auto& failures = want->failures[call];
    if (failures == 0) return false;
    if (want->before[call] > 0) {
        --want->before[call];
        return false;
    }
    if (failures > 0) --failures;
    ++want->failed[call];
    errno = want->error[call];
    return true;
}

template <class Function>
Function next(const char* name) {
    return reinterpret_cast<Function>(::dlsym(RTLD_NEXT, name));
}

int opened(int file, const char* path) {
    if (file >= 0 && file < most_files) of_the_store[file] = is_store(path);
    return file;
}

mode_t mode_of(int flags, va_list more) {
    return (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(more, mode_t) : mode_t{0};
}

int slow_sync(int file, int (*sync)(int)) {
    if (!is_store(file)) return sync(file);
    if (fails(sync_call)) return -1;
    if (auto* want = wanted(); want != nullptr && want->sync_us > 0)
        ::usleep(static_cast<useconds_t>(want->sync_us.load()));
    return sync(file);
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
    static const auto real = next<int (*)(const char*, int, ...)>("open");
    va_list more;
    va_start(more, flags);
    auto mode = mode_of(flags, more);
    va_end(more);
    return is_store(path) && fails(open_call) ? -1 : opened(real(path, flags, mode), path);
}
int open64(const char* path, int flags, ...) {
    static const auto real = next<int (*)(const char*, int, ...)>("open64");
    va_list more;
    va_start(more, flags);
    auto mode = mode_of(flags, more);
    va_end(more);
    return is_store(path) && fails(open_call) ? -1 : opened(real(path, flags, mode), path);
}
int close(int file) {
    static const auto real = next<int (*)(int)>("close");
    if (file >= 0 && file < most_files) of_the_store[file] = false;
    return real(file);
}
ssize_t pwrite(int file, const void* data, size_t size, off_t at) {
    static const auto real = next<ssize_t (*)(int, const void*, size_t, off_t)>("pwrite");
    return is_store(file) && fails(write_call) ? -1 : real(file, data, size, at);
}
ssize_t pwrite64(int file, const void* data, size_t size, off64_t at) {
    static const auto real = next<ssize_t (*)(int, const void*, size_t, off64_t)>("pwrite64");
    return is_store(file) && fails(write_call) ? -1 : real(file, data, size, at);
}
ssize_t write(int file, const void* data, size_t size) {
    static const auto real = next<ssize_t (*)(int, const void*, size_t)>("write");
    return is_store(file) && fails(write_call) ? -1 : real(file, data, size);
}
int fsync(int file) {
    static const auto real = next<int (*)(int)>("fsync");
    return slow_sync(file, real);
}
int fdatasync(int file) {
    static const auto real = next<int (*)(int)>("fdatasync");
    return slow_sync(file, real);
}
}
