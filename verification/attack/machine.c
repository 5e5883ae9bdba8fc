/* Gives the programs that load it another time of day, and a disk that cannot be written.
 *
 * MACHINE_OFFSET names a file with the seconds by which the time of day is wrong. While the file that MACHINE_READ_ONLY names is there, what
 * is written to files fails with EROFS, as on a file system that the kernel has made read-only. Time that only passes (CLOCK_MONOTONIC) and
 * what is written to sockets and pipes stay as they are.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

#define REAL(name) static __typeof__(&name) real; if (!real) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

static long offset(void) {
    char text[32] = "";
    const char *path = getenv("MACHINE_OFFSET");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0) return 0;
    ssize_t size = read(file, text, sizeof text - 1);
    close(file);
    return size > 0 ? atol(text) : 0;
}

static int is_refused(int file) {
    struct stat status;
    const char *path = getenv("MACHINE_READ_ONLY");
    if (!path || access(path, F_OK) || fstat(file, &status) || !S_ISREG(status.st_mode)) return 0;
    errno = EROFS;
    return 1;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    REAL(clock_gettime);
    int result = real(clock, now);
    if (!result && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) now->tv_sec += offset();
    return result;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    REAL(gettimeofday);
    int result = real(now, zone);
    if (!result) now->tv_sec += offset();
    return result;
}

time_t time(time_t *result) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (result) *result = now.tv_sec;
    return now.tv_sec;
}

ssize_t write(int file, const void *content, size_t size) {
    REAL(write);
    return is_refused(file) ? -1 : real(file, content, size);
}

ssize_t pwrite64(int file, const void *content, size_t size, off64_t place) {
    REAL(pwrite64);
    return is_refused(file) ? -1 : real(file, content, size, place);
}

ssize_t pwrite(int file, const void *content, size_t size, off_t place) {
    REAL(pwrite);
    return is_refused(file) ? -1 : real(file, content, size, place);
}

int ftruncate64(int file, off64_t size) {
    REAL(ftruncate64);
    return is_refused(file) ? -1 : real(file, size);
}

int fdatasync(int file) {
    REAL(fdatasync);
    return is_refused(file) ? -1 : real(file);
}
