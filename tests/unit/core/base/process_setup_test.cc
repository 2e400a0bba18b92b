#include "core/base/process_setup.h"

#include <unistd.h>

#include <cstdlib>

#include "gtest/gtest.h"
#include <openssl/crypto.h>

namespace isoscope::base {
namespace {

constexpr int kUsable = 0;
constexpr int kGone = 3;

// Ends the process once the handlers that OpenSSL registers for exit() have run.
[[noreturn]] void EndAfterOpenSsl() {
  std::atexit([] { _exit(OPENSSL_init_crypto(0, nullptr) == 1 ? kUsable : kGone); });
  SetUpProcess();
  OPENSSL_init_crypto(OPENSSL_INIT_ADD_ALL_CIPHERS, nullptr);  // as gRPC does for its first channel
  std::exit(kUsable);
}

TEST(ProcessSetupTest, ThreadsMayUseOpenSslUntilTheProcessIsGone) {
  // Its own process: this one may have used OpenSSL before.
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(EndAfterOpenSsl(), ::testing::ExitedWithCode(kUsable), "");
}

}  // namespace
}  // namespace isoscope::base
