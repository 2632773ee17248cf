/* A disk that fails: preloaded, it counts the calls that change what lies below a folder, and lets the n-th fail.

   FAULT_UNDER  the folder;  FAULT_AT  which call, from 1; 0 for none;  FAULT_KIND  ENOSPC, EIO or KILL
   FAULT_LOG    a file that gets a line a call: its number, its name, what it was about
   cc -shared -fPIC -o faulty_disk.so faulty_disk.c -ldl */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

static int calls;

static int below(const char *path) {
    const char *under = getenv("FAULT_UNDER");
    char real[PATH_MAX], cwd[PATH_MAX];
    if (!under || !path) return 0;
    if (path[0] != '/' && getcwd(cwd, sizeof cwd)) {
        snprintf(real, sizeof real, "%s/%s", cwd, path);
        path = real;
    }
    return strncmp(path, under, strlen(under)) == 0;
}

static int below_fd(int fd, char *path) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, PATH_MAX - 1);
    if (n < 0) return 0;
    path[n] = 0;
    return path[0] == '/' && below(path); /* a pipe has no place on a disk */
}

/* 1 if this call is to fail, errno set */
static int fails(const char *name, const char *about) {
    const char *at = getenv("FAULT_AT"), *kind = getenv("FAULT_KIND"), *log = getenv("FAULT_LOG");
    int n = __sync_add_and_fetch(&calls, 1);
    if (log) {
        char line[PATH_MAX + 64];
        int length = snprintf(line, sizeof line, "%d %s %s\n", n, name, about ? about : "");
        int fd = syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND, 0644);
        if (fd >= 0) {
            syscall(SYS_write, fd, line, length);
            syscall(SYS_close, fd);
        }
    }
    if (!at || n != atoi(at)) return 0;
    if (kind && !strcmp(kind, "KILL")) kill(getpid(), SIGKILL);
    errno = kind && !strcmp(kind, "EIO") ? EIO : ENOSPC;
    return 1;
}

#define REAL(result, name, ...) static result (*real)(__VA_ARGS__); if (!real) real = dlsym(RTLD_NEXT, name)

ssize_t write(int fd, const void *data, size_t size) {
    REAL(ssize_t, "write", int, const void *, size_t);
    char path[PATH_MAX];
    if (below_fd(fd, path) && fails("write", path)) return -1;
    return real(fd, data, size);
}

int fsync(int fd) {
    REAL(int, "fsync", int);
    char path[PATH_MAX];
    if (below_fd(fd, path) && fails("fsync", path)) return -1;
    return real(fd);
}

int rename(const char *from, const char *to) {
    REAL(int, "rename", const char *, const char *);
    if (below(to) && fails("rename", to)) return -1;
    return real(from, to);
}

int renameat2(int a, const char *from, int b, const char *to, unsigned flags) {
    REAL(int, "renameat2", int, const char *, int, const char *, unsigned);
    if (below(to) && fails("renameat2", to)) return -1;
    return real(a, from, b, to, flags);
}

int link(const char *from, const char *to) {
    REAL(int, "link", const char *, const char *);
    if (below(to) && fails("link", to)) return -1;
    return real(from, to);
}

int mkdir(const char *path, mode_t mode) {
    REAL(int, "mkdir", const char *, mode_t);
    if (below(path) && fails("mkdir", path)) return -1;
    return real(path, mode);
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
    REAL(ssize_t, "writev", int, const struct iovec *, int);
    char path[PATH_MAX];
    if (below_fd(fd, path) && fails("writev", path)) return -1;
    return real(fd, parts, count);
}

ssize_t pwrite64(int fd, const void *data, size_t size, off64_t at) {
    REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t);
    char path[PATH_MAX];
    if (below_fd(fd, path) && fails("pwrite64", path)) return -1;
    return real(fd, data, size, at);
}

int fdatasync(int fd) {
    REAL(int, "fdatasync", int);
    char path[PATH_MAX];
    if (below_fd(fd, path) && fails("fdatasync", path)) return -1;
    return real(fd);
}

int ftruncate64(int fd, off64_t size) {
    REAL(int, "ftruncate64", int, off64_t);
    char path[PATH_MAX];
    if (below_fd(fd, path) && fails("ftruncate64", path)) return -1;
    return real(fd, size);
}

/* only what makes a file */
int open64(const char *path, int flags, ...) {
    REAL(int, "open64", const char *, int, ...);
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    if (flags & O_CREAT && below(path) && fails("open64", path)) return -1;
    return real(path, flags, mode);
}

int unlink(const char *path) {
    REAL(int, "unlink", const char *);
    if (below(path) && fails("unlink", path)) return -1;
    return real(path);
}

int rmdir(const char *path) {
    REAL(int, "rmdir", const char *);
    if (below(path) && fails("rmdir", path)) return -1;
    return real(path);
}

/* how shutil.rmtree removes */
int unlinkat(int at, const char *path, int flags) {
    REAL(int, "unlinkat", int, const char *, int);
    char folder[PATH_MAX];
    if (below_fd(at, folder) && fails("unlinkat", folder)) return -1;
    return real(at, path, flags);
}
