#include "wire/enum_table.h"

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::wire {
namespace {

enum class Shape { kRound, kSquare, kUnknown };
enum Wire : int { kUnset = 0, kWireRound = 1, kWireSquare = 2 };

constexpr EnumRow<Shape, Wire> kShapes[] = {
    {Shape::kRound, kWireRound}, {Shape::kRound, kUnset}, {Shape::kSquare, kWireSquare}};

TEST(EnumTableTest, EveryRowIsReadBothWaysAndTheFirstIsTheWayBack) {
  for (const auto& [core, wire] : kShapes) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Shape shape, EnumFromProto(kShapes, wire, "shape", ""));
    EXPECT_EQ(shape, core);
  }
  EXPECT_EQ(EnumToProto(kShapes, Shape::kRound), kWireRound);
  EXPECT_EQ(EnumToProto(kShapes, Shape::kSquare), kWireSquare);
}

TEST(EnumTableTest, AValueWithoutARowIsNamed) {
  const absl::Status status =
      EnumFromProto(kShapes, static_cast<Wire>(7), "shape", "must be 1 or 2").status();
  EXPECT_EQ(status, absl::InvalidArgumentError("shape is 7: must be 1 or 2"));
  EXPECT_EQ(EnumToProto(kShapes, Shape::kUnknown), kUnset);
}

}  // namespace
}  // namespace isoscope::wire
