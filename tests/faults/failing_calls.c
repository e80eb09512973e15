/* Preloaded into the processes of the campaign: lets the calls of one process that change files below a folder fail.

   Python's hooks do not see the writes of FFmpeg, HDF5, LMDB and NumPy, nor short writes, nor a failing close.
   fail_calls(folder, first, last, error, shorten): calls number first to last, from 1 on, fail with ``error``; with
   ``shorten``, write number ``first`` is cut to half instead, and only writes fail after it. Folder "" ends this.
   failing_calls(): the number of calls so far. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static char below[PATH_MAX];
static int first_call, last_call, code, cuts, calls;
enum { PASS, FAIL, SHORT };

void fail_calls(const char *folder, int first, int last, int error, int shorten) {
    first_call = first, last_call = last, code = error, cuts = shorten, calls = 0;
    snprintf(below, sizeof below, "%s%s", folder, *folder ? "/" : "");
}

int failing_calls(void) { return calls; }

static int next_call(int writes) {
    calls++;
    int now = PASS;
    if (cuts && calls == first_call) now = writes ? SHORT : PASS;
    else if (calls >= first_call && calls <= last_call && (writes || !cuts)) now = FAIL;
    if (now == FAIL) errno = code;
    return now;
}

static int of_path(const char *path, int writes) {
    char folder[PATH_MAX], whole[2 * PATH_MAX];
    if (!below[0] || !path) return PASS;
    if (path[0] != '/') {
        if (!getcwd(folder, sizeof folder)) return PASS;
        snprintf(whole, sizeof whole, "%s/%s", folder, path);
        path = whole;
    }
    return strncmp(path, below, strlen(below)) ? PASS : next_call(writes);
}

static int of_file(int file, int writes) {
    char link[64], path[PATH_MAX];
    if (!below[0]) return PASS;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    path[length < 0 ? 0 : length] = 0;
    return strncmp(path, below, strlen(below)) ? PASS : next_call(writes);
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name)
#define WRITE(name, ...) \
    int now = of_file(file, 1); \
    if (now == FAIL) return -1; \
    if (now == SHORT && size > 1) size /= 2; \
    return real(file, data, size, ##__VA_ARGS__)

ssize_t write(int file, const void *data, size_t size) { REAL(ssize_t, write, int, const void *, size_t); WRITE(write); }
ssize_t pwrite(int file, const void *data, size_t size, off_t at) {
    REAL(ssize_t, pwrite, int, const void *, size_t, off_t);
    WRITE(pwrite, at);
}
ssize_t pwrite64(int file, const void *data, size_t size, off64_t at) {
    REAL(ssize_t, pwrite64, int, const void *, size_t, off64_t);
    WRITE(pwrite64, at);
}

#define ON_FILE(name) \
    int name(int file) { REAL(int, name, int); return of_file(file, 0) == FAIL ? -1 : real(file); }
ON_FILE(fsync)
ON_FILE(fdatasync)

int close(int file) { /* closes in any case, as Linux does */
    REAL(int, close, int);
    int flags = below[0] ? fcntl(file, F_GETFL) : -1, failed = 0;
    if (flags >= 0 && (flags & O_ACCMODE) != O_RDONLY) failed = of_file(file, 0) == FAIL;
    int result = real(file);
    if (!failed) return result;
    errno = code;
    return -1;
}

#define RESIZE(name, type) \
    int name(int file, type size) { REAL(int, name, int, type); return of_file(file, 0) == FAIL ? -1 : real(file, size); }
RESIZE(ftruncate, off_t)
RESIZE(ftruncate64, off64_t)

#define ON_TWO(name) \
    int name(const char *from, const char *to) { \
        REAL(int, name, const char *, const char *); \
        return of_path(to, 0) == FAIL ? -1 : real(from, to); \
    }
ON_TWO(rename)
ON_TWO(link)

int mkdir(const char *path, mode_t mode) {
    REAL(int, mkdir, const char *, mode_t);
    return of_path(path, 0) == FAIL ? -1 : real(path, mode);
}

#define OPEN(name) \
    int name(const char *path, int flags, ...) { \
        REAL(int, name, const char *, int, ...); \
        va_list more; \
        va_start(more, flags); \
        mode_t mode = flags & O_CREAT ? va_arg(more, mode_t) : 0; \
        va_end(more); \
        int changes = (flags & O_ACCMODE) != O_RDONLY || flags & O_CREAT; \
        return changes && of_path(path, 0) == FAIL ? -1 : real(path, flags, mode); \
    }
OPEN(open)
OPEN(open64)
