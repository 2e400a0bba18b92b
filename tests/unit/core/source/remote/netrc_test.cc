#include "core/source/remote/netrc.h"

#include <string>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

std::string Found(absl::string_view text, absl::string_view host) {
  const auto entry = FindInNetrc(text, host);
  return entry ? entry->login + ":" + entry->password.Reveal() : "none";
}

TEST(NetrcTest, FindsTheHostsEntry) {
  const char* const text =
      "# machine a.org login no password no\n"
      "machine a.org login ada password engine\n"
      "machine B.org\n  login bob\n  account x\n  password \"with space \\\"q\\\"\"\n"
      "macdef init\nmachine c.org login no password no\n\n"
      "machine c.org login cy password secret\n"
      "default login any password body\n";
  EXPECT_EQ(Found(text, "a.org"), "ada:engine");
  EXPECT_EQ(Found(text, "b.org"), "bob:with space \"q\"");
  EXPECT_EQ(Found(text, "c.org"), "cy:secret");
  EXPECT_EQ(Found(text, "d.org"), "none");
  EXPECT_EQ(Found(text, "org"), "none");
}

TEST(NetrcTest, EndsAtAnyByte) {
  const std::string text = "machine a.org login \"ada\\\" password engine\nmacdef x\nmachine";
  for (std::size_t size = 0; size <= text.size(); ++size) {
    static_cast<void>(FindInNetrc(absl::string_view(text).substr(0, size), "a.org"));
  }
  EXPECT_EQ(Found("machine a.org password p", "a.org"), "none");
  EXPECT_EQ(Found("machine a.org login", "a.org"), "none");
}

}  // namespace
}  // namespace isoscope::source
