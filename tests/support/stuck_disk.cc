// Preloaded into a program (LD_PRELOAD), a disk that takes bytes and never says that it has them.

#include <unistd.h>

extern "C" int fsync(int /*descriptor*/) {
  while (true) {
    pause();
  }
}
