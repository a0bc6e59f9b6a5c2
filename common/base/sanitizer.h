/* sanitizer.h: whether this build runs under a sanitizer that brings shadow memory and handlers of its own:
 * limits of memory and traps for crashes then stay away.
 * Threads: constants. */
#ifndef LW_COMMON_BASE_SANITIZER_H
#define LW_COMMON_BASE_SANITIZER_H

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LW_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define LW_SANITIZER 1
#endif
#endif
#ifndef LW_SANITIZER
#define LW_SANITIZER 0
#endif

#endif
