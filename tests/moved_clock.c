/* SPDX-License-Identifier: Apache-2.0 */
/* Preloaded into programs, this moves their time of day by MOVED_CLOCK_S; steady clocks stay. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>

#define REAL(name) ((__typeof__(&name))real(#name))

static void *real(const char *name) { return dlsym(RTLD_NEXT, name); }

static time_t move_s;

__attribute__((constructor)) static void read_move(void) {
  const char *text = getenv("MOVED_CLOCK_S");
  move_s = text ? atol(text) : 0;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
  static __typeof__(&clock_gettime) unmoved;
  if (!unmoved) unmoved = REAL(clock_gettime);
  int failed = unmoved(clock, now);
  if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    now->tv_sec += move_s;
  return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
  int failed = REAL(gettimeofday)(now, zone);
  if (!failed) now->tv_sec += move_s;
  return failed;
}

time_t time(time_t *now) {
  struct timespec moved;
  clock_gettime(CLOCK_REALTIME, &moved);
  if (now) *now = moved.tv_sec;
  return moved.tv_sec;
}

/* A deadline of the kernel, for one that was computed from the moved time of day. */
static struct timespec kernel_time(const struct timespec *deadline) {
  struct timespec moved, unmoved = *deadline;
  clock_gettime(CLOCK_REALTIME, &moved);
  /* A steady clock is far behind the time of day. */
  if (deadline->tv_sec > moved.tv_sec / 2) unmoved.tv_sec -= move_s;
  return unmoved;
}

int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict deadline) {
  struct timespec unmoved = kernel_time(deadline);
  return REAL(pthread_cond_timedwait)(condition, mutex, &unmoved);
}

int pthread_mutex_timedlock(pthread_mutex_t *restrict mutex,
                            const struct timespec *restrict deadline) {
  struct timespec unmoved = kernel_time(deadline);
  return REAL(pthread_mutex_timedlock)(mutex, &unmoved);
}

int sem_timedwait(sem_t *restrict semaphore, const struct timespec *restrict deadline) {
  struct timespec unmoved = kernel_time(deadline);
  return REAL(sem_timedwait)(semaphore, &unmoved);
}
