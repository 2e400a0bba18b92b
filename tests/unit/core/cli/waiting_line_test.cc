#include "core/cli/waiting_line.h"

#include <cstddef>
#include <ostream>
#include <sstream>
#include <streambuf>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::cli {
namespace {

using ::testing::ContainsRegex;

// Text that one thread writes to a stream and another one reads. Thread-safe.
class SharedText final : public std::streambuf {
 public:
  // Guards against a hang. Returns whether the text has come.
  bool WaitFor(const std::string& part) {
    base::MutexLock lock(&mutex_);
    return written_.AwaitUntil(
        &mutex_, base::MonotonicNow() + absl::Seconds(60),
        [&]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return text_.find(part) != std::string::npos; });
  }
  std::string Get() {
    const base::MutexLock lock(&mutex_);
    return text_;
  }

 protected:
  std::streamsize xsputn(const char* bytes, std::streamsize count) override {
    const base::MutexLock lock(&mutex_);
    text_.append(bytes, static_cast<std::size_t>(count));
    written_.SignalAll();
    return count;
  }
  int_type overflow(int_type byte) override {
    const char one = traits_type::to_char_type(byte);
    return xsputn(&one, 1) == 1 ? byte : traits_type::eof();
  }

 private:
  base::Mutex mutex_;
  base::CondVar written_;
  std::string text_ ABSL_GUARDED_BY(mutex_);
};

TEST(WaitingLineTest, ShortWorkAndFilesGetNoByte) {
  std::ostringstream err;
  { const WaitingLine line(&err, /*is_terminal=*/true, "rendering", absl::Hours(1)); }
  {
    const WaitingLine line(&err, /*is_terminal=*/false, "rendering", absl::ZeroDuration());
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_EQ(err.str(), "");
}

TEST(WaitingLineTest, LongWorkIsNamedAndTheLineClearedAtTheEnd) {
  SharedText text;
  std::ostream err(&text);
  {
    const WaitingLine line(&err, /*is_terminal=*/true, "rendering", absl::ZeroDuration());
    EXPECT_TRUE(text.WaitFor("rendering   "));
  }
  const std::string written = text.Get();
  EXPECT_THAT(written, ContainsRegex("rendering   [0-9]+ s"));
  ASSERT_GE(written.size(), 3U);
  EXPECT_EQ(written.substr(written.size() - 3), "\x1B[K") << "the line is cleared";
}

}  // namespace
}  // namespace isoscope::cli
