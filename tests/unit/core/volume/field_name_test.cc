// Symptom: a field whose name has a colon could not be chosen.

#include "core/volume/field_name.h"

#include <algorithm>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::volume {
namespace {

std::string Found(const std::vector<std::string>& names, absl::string_view text) {
  const auto found = FindFieldName(text, [&](absl::string_view name) -> std::optional<std::size_t> {
    const auto field = std::find(names.begin(), names.end(), name);
    return field == names.end()
               ? std::nullopt
               : std::optional<std::size_t>(static_cast<std::size_t>(field - names.begin()));
  });
  return found.has_value() ? names[found->field] + "|" + found->component : "none";
}

TEST(FieldNameTest, TheWholeTextGoesFirstThenTheLongestName) {
  const std::vector<std::string> names{"a", "a:b", "a:b:c", "velocity", "E/x"};
  EXPECT_EQ(Found(names, "a"), "a|");
  EXPECT_EQ(Found(names, "a:x"), "a|x");
  EXPECT_EQ(Found(names, "a:b"), "a:b|");
  EXPECT_EQ(Found(names, "a:b:x"), "a:b|x");
  EXPECT_EQ(Found(names, "a:b:c"), "a:b:c|");
  EXPECT_EQ(Found(names, "a:b:c:0"), "a:b:c|0");
  EXPECT_EQ(Found(names, "a:b:d:e"), "a:b|d:e");
  EXPECT_EQ(Found(names, "velocity:x"), "velocity|x");
  EXPECT_EQ(Found(names, "E/x"), "E/x|");
}

TEST(FieldNameTest, NothingIsFoundInTextsWithoutAName) {
  const std::vector<std::string> names{"a", "b:c"};
  for (const char* text : {"", ":", ":a", "a:", "b", "b:", "b:x", "c", "A", "a :x"}) {
    EXPECT_EQ(Found(names, text), "none") << text;
  }
}

}  // namespace
}  // namespace isoscope::volume
