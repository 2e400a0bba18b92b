#include "core/volume/patient_frame.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(PatientFrameTest, TheDefaultIsTheWorldOfDicom) {
  const PatientFrame frame;
  EXPECT_EQ(frame.name(), "LPS");
  EXPECT_EQ(frame.DirectionTo(PatientSide::kLeft), (math::Vec3d{1, 0, 0}));
  EXPECT_EQ(frame.DirectionTo(PatientSide::kRight), (math::Vec3d{-1, 0, 0}));
  EXPECT_EQ(frame.DirectionTo(PatientSide::kPosterior), (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(frame.DirectionTo(PatientSide::kAnterior), (math::Vec3d{0, -1, 0}));
  EXPECT_EQ(frame.DirectionTo(PatientSide::kSuperior), (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(frame.DirectionTo(PatientSide::kInferior), (math::Vec3d{0, 0, -1}));
}

TEST(PatientFrameTest, EveryOrderOfThePairsIsAFrame) {
  int count = 0;
  const std::string letters = "LRPASI";
  for (const char a : letters) {
    for (const char b : letters) {
      for (const char c : letters) {
        const auto frame = PatientFrame::FromName(std::string{a, b, c});
        if (frame.ok()) {
          ++count;
          EXPECT_EQ(frame->DirectionTo(static_cast<PatientSide>(a)), (math::Vec3d{1, 0, 0}));
          EXPECT_EQ(frame->DirectionTo(static_cast<PatientSide>(b)), (math::Vec3d{0, 1, 0}));
          EXPECT_EQ(frame->DirectionTo(static_cast<PatientSide>(c)), (math::Vec3d{0, 0, 1}));
        }
      }
    }
  }
  EXPECT_EQ(count, 48);  // 3! orders, 2^3 signs
}

TEST(PatientFrameTest, WhatIsNoFrameIsRefused) {
  for (const char* name : {"", "LP", "LPSS", "LRS", "lps", "LLS", "XYZ", "L S"}) {
    EXPECT_THAT(PatientFrame::FromName(name),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("three letters")))
        << name;
  }
}

}  // namespace
}  // namespace isoscope::volume
