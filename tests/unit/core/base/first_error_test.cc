#include "core/base/first_error.h"

#include <thread>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(FirstErrorTest, NothingIsNoError) {
  FirstError error;
  error.Set(absl::OkStatus());
  EXPECT_FALSE(error.has_error());
  EXPECT_TRUE(error.status().ok());
}

TEST(FirstErrorTest, LaterErrorsAndSuccessesDoNotReplaceTheFirst) {
  FirstError error;
  error.Set(absl::DataLossError("first"));
  error.Set(absl::InternalError("second"));
  error.Set(absl::OkStatus());
  EXPECT_TRUE(error.has_error());
  EXPECT_EQ(error.status(), absl::DataLossError("first"));
}

TEST(FirstErrorTest, OneOfTheErrorsOfManyThreadsStays) {
  FirstError error;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&error] {
      for (int k = 0; k < 100; ++k) {
        error.Set(absl::DataLossError("damaged"));
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_TRUE(error.has_error());
  EXPECT_EQ(error.status(), absl::DataLossError("damaged"));
}

}  // namespace
}  // namespace isoscope::base
