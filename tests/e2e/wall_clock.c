/* For LD_PRELOAD: a program's wall clock is ahead by what the file named by GANTRY_WALL_CLOCK says, eight bytes of
   nanoseconds, which may change at any time. Its other clocks, which timers run on, are left alone; with
   GANTRY_STEADY_CLOCK set they jump as well, which is what a proof must find out. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t* ahead;
static int steady_too;

__attribute__((constructor)) static void begin(void) {
    const char* path = getenv("GANTRY_WALL_CLOCK");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    steady_too = getenv("GANTRY_STEADY_CLOCK") != NULL;
    if (fd < 0) return;
    void* mapped = mmap(NULL, sizeof *ahead, PROT_READ, MAP_SHARED, fd, 0);
    close(fd);
    if (mapped != MAP_FAILED) ahead = mapped;
}

int clock_gettime(clockid_t clock, struct timespec* out) {
    /* Not by dlsym: a sanitizer asks for the time before it is ready for that. */
    int done = (int)syscall(SYS_clock_gettime, clock, out);
    int wall = clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE;
    int steady = steady_too && clock == CLOCK_MONOTONIC;
    if (done != 0 || !ahead || !(wall || steady)) return done;
    const int64_t second = 1000000000;
    int64_t all = (int64_t)out->tv_sec * second + out->tv_nsec + *ahead;
    out->tv_sec = all / second;
    out->tv_nsec = all % second;
    return 0;
}

int gettimeofday(struct timeval* restrict out, void* restrict zone) {
    (void)zone;
    struct timespec now;
    int done = clock_gettime(CLOCK_REALTIME, &now);
    out->tv_sec = now.tv_sec;
    out->tv_usec = now.tv_nsec / 1000;
    return done;
}

time_t time(time_t* out) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (out) *out = now.tv_sec;
    return now.tv_sec;
}
