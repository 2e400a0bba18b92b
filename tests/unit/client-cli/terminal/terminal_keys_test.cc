#include "client-cli/terminal/terminal_keys.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Kind = Key::Kind;

Key Character(char c) { return {.kind = Kind::kCharacter, .character = c}; }
Key Arrow(Kind kind, bool has_shift = false) { return {.kind = kind, .has_shift = has_shift}; }

TEST(KeyReaderTest, ReadsCharactersAndArrowsOfBothModes) {
  KeyReader keys;
  EXPECT_THAT(keys.Take("q\x1B[A\x1BOB\x1B[C\x1B[1;2D+"),
              ElementsAre(Character('q'), Arrow(Kind::kUp), Arrow(Kind::kDown), Arrow(Kind::kRight),
                          Arrow(Kind::kLeft, true), Character('+')));
  EXPECT_THAT(keys.Take("\x1B[H\x1B[1~\x1BOH"),
              ElementsAre(Arrow(Kind::kHome), Arrow(Kind::kHome), Arrow(Kind::kHome)));
}

TEST(KeyReaderTest, EveryCutOfASequenceGivesTheSameKeys) {
  const std::string bytes = "a\x1B[1;2Ab\x1BOCc\x1B[Ad";
  KeyReader whole;
  const std::vector<Key> expected = whole.Take(bytes);
  ASSERT_EQ(expected.size(), 7);
  for (std::size_t cut = 0; cut <= bytes.size(); ++cut) {
    KeyReader parts;
    std::vector<Key> keys = parts.Take(bytes.substr(0, cut));
    for (const Key& key : parts.Take(bytes.substr(cut))) {
      keys.push_back(key);
    }
    EXPECT_EQ(keys, expected) << cut;
  }
}

TEST(KeyReaderTest, OtherKeysAndLongNonsenseAreLeftOut) {
  KeyReader keys;
  EXPECT_THAT(keys.Take("\x1B[15~\x1B[3~\x1B[?62;4c\xC3\xA4"), IsEmpty());
  EXPECT_THAT(keys.Take("\x1B\x1B[A"), ElementsAre(Arrow(Kind::kUp)));
  EXPECT_THAT(keys.Take("\x1Bq"), ElementsAre(Character('q')));
  EXPECT_THAT(keys.Take("\x1B[" + std::string(100, '1')), IsEmpty());
  EXPECT_THAT(keys.Take("x"), ElementsAre(Character('x')));
}

}  // namespace
}  // namespace isoscope::cli
