#pragma once
#include <sqlite3.h>

#include <cstddef>
#include <cstring>
#include <string>

// A file system under SQLite that fails when told to. While one lives it is SQLite's default.
namespace gantry::journal::tests {

class FaultyVfs {
public:
    enum class Call { write, sync, open, truncate, shared_memory };

    FaultyVfs() {
        under_ = sqlite3_vfs_find(nullptr);
        vfs_ = *under_;
        vfs_.zName = "faulty";
        vfs_.pNext = nullptr;
        vfs_.szOsFile = static_cast<int>(sizeof(File)) + under_->szOsFile;
        vfs_.pAppData = this;
        vfs_.xOpen = open;
        vfs_.xDelete = [](sqlite3_vfs* vfs, const char* name, int sync) {
            return of(vfs).under_->xDelete(of(vfs).under_, name, sync);
        };
        vfs_.xAccess = [](sqlite3_vfs* vfs, const char* name, int flags, int* out) {
            return of(vfs).under_->xAccess(of(vfs).under_, name, flags, out);
        };
        vfs_.xFullPathname = [](sqlite3_vfs* vfs, const char* name, int size, char* out) {
            return of(vfs).under_->xFullPathname(of(vfs).under_, name, size, out);
        };
        sqlite3_vfs_register(&vfs_, 1);
    }
    ~FaultyVfs() {
        sqlite3_vfs_unregister(&vfs_);
        sqlite3_vfs_register(under_, 1);
    }
    FaultyVfs(const FaultyVfs&) = delete;
    FaultyVfs& operator=(const FaultyVfs&) = delete;

    // The `at`-th call from now (1 is the next) and `more` calls after it fail with `code`.
    void fail(Call call, int at, int code, int more = 0) {
        call_ = call;
        before_ = at - 1;
        failures_ = 1 + more;
        code_ = code;
        fired_ = false;
    }
    void heal() { failures_ = 0; }
    bool fired() const { return fired_; }

private:
    struct File {
        sqlite3_file base;
        FaultyVfs* vfs;
        sqlite3_file* under;
    };
    static FaultyVfs& of(sqlite3_vfs* vfs) { return *static_cast<FaultyVfs*>(vfs->pAppData); }
    static File& of(sqlite3_file* file) { return *reinterpret_cast<File*>(file); }
    static sqlite3_file* under(sqlite3_file* file) { return of(file).under; }

    // SQLITE_OK, or the failure that is due.
    int due(Call call) {
        if (failures_ == 0 || call != call_) return SQLITE_OK;
        if (before_ > 0) {
            --before_;
            return SQLITE_OK;
        }
        --failures_;
        fired_ = true;
        return code_;
    }

    static int open(sqlite3_vfs* vfs, const char* name, sqlite3_file* raw, int flags, int* out) {
        auto& file = of(raw);
        file.base.pMethods = nullptr;
        file.vfs = &of(vfs);
        file.under = reinterpret_cast<sqlite3_file*>(reinterpret_cast<std::byte*>(raw) + sizeof(File));
        if (file.vfs->due(Call::open) != SQLITE_OK) return SQLITE_CANTOPEN;
        int code = file.vfs->under_->xOpen(file.vfs->under_, name, file.under, flags, out);
        if (code == SQLITE_OK) file.base.pMethods = methods();
        return code;
    }

    static const sqlite3_io_methods* methods() {
        static const sqlite3_io_methods table = [] {
            sqlite3_io_methods m{};
            m.iVersion = 2;
            m.xClose = [](sqlite3_file* f) { return under(f)->pMethods->xClose(under(f)); };
            m.xRead = [](sqlite3_file* f, void* to, int size, sqlite3_int64 at) {
                return under(f)->pMethods->xRead(under(f), to, size, at);
            };
            m.xWrite = [](sqlite3_file* f, const void* from, int size, sqlite3_int64 at) {
                int code = of(f).vfs->due(Call::write);
                if (code == SQLITE_OK) return under(f)->pMethods->xWrite(under(f), from, size, at);
                // As a dying disk does it: half of it arrives.
                under(f)->pMethods->xWrite(under(f), from, size / 2, at);
                return code;
            };
            m.xTruncate = [](sqlite3_file* f, sqlite3_int64 size) {
                int code = of(f).vfs->due(Call::truncate);
                return code != SQLITE_OK ? code : under(f)->pMethods->xTruncate(under(f), size);
            };
            m.xSync = [](sqlite3_file* f, int flags) {
                int code = of(f).vfs->due(Call::sync);
                return code != SQLITE_OK ? code : under(f)->pMethods->xSync(under(f), flags);
            };
            m.xFileSize = [](sqlite3_file* f, sqlite3_int64* out) {
                return under(f)->pMethods->xFileSize(under(f), out);
            };
            m.xLock = [](sqlite3_file* f, int level) { return under(f)->pMethods->xLock(under(f), level); };
            m.xUnlock = [](sqlite3_file* f, int level) {
                return under(f)->pMethods->xUnlock(under(f), level);
            };
            m.xCheckReservedLock = [](sqlite3_file* f, int* out) {
                return under(f)->pMethods->xCheckReservedLock(under(f), out);
            };
            m.xFileControl = [](sqlite3_file* f, int what, void* with) {
                return under(f)->pMethods->xFileControl(under(f), what, with);
            };
            m.xSectorSize = [](sqlite3_file* f) { return under(f)->pMethods->xSectorSize(under(f)); };
            m.xDeviceCharacteristics = [](sqlite3_file* f) {
                return under(f)->pMethods->xDeviceCharacteristics(under(f));
            };
            m.xShmMap = [](sqlite3_file* f, int page, int size, int extend, void volatile** out) {
                int code = of(f).vfs->due(Call::shared_memory);
                return code != SQLITE_OK ? code
                                         : under(f)->pMethods->xShmMap(under(f), page, size, extend, out);
            };
            m.xShmLock = [](sqlite3_file* f, int at, int count, int flags) {
                return under(f)->pMethods->xShmLock(under(f), at, count, flags);
            };
            m.xShmBarrier = [](sqlite3_file* f) { under(f)->pMethods->xShmBarrier(under(f)); };
            m.xShmUnmap = [](sqlite3_file* f, int erase) {
                return under(f)->pMethods->xShmUnmap(under(f), erase);
            };
            return m;
        }();
        return &table;
    }

    sqlite3_vfs* under_ = nullptr;
    sqlite3_vfs vfs_{};
    Call call_{};
    int before_ = 0, failures_ = 0, code_ = 0;
    bool fired_ = false;
};

}  // namespace gantry::journal::tests
