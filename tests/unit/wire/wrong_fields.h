// Requests with one number wrong, as tables of fields and values.

#ifndef ISOSCOPE_TESTS_UNIT_WIRE_WRONG_FIELDS_H_
#define ISOSCOPE_TESTS_UNIT_WIRE_WRONG_FIELDS_H_

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/check.h"
#include "tests/support/status_matchers.h"
#include "wire/frame_convert.h"

namespace isoscope::wire {

// A request that is right.
inline isoscope::v1::RenderIsosurfaceRequest MakeRequest() {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(60);
  request.mutable_viewport()->set_width_px(40);
  request.mutable_viewport()->set_height_px(30);
  return request;
}

// Sets the number, or the enum, at a path such as "lights[0].direction.z". Lists must have the
// elements that it names.
inline void SetField(const std::string& path, double value, google::protobuf::Message* message) {
  using Field = google::protobuf::FieldDescriptor;
  const std::vector<std::string> steps = absl::StrSplit(path, '.');
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const std::pair<std::string, std::string> step =
        absl::StrSplit(steps[i], absl::MaxSplits('[', 1));
    const Field* const field = message->GetDescriptor()->FindFieldByName(step.first);
    ISOSCOPE_CHECK(field != nullptr);
    const google::protobuf::Reflection& reflection = *message->GetReflection();
    if (i + 1 < steps.size()) {
      message = field->is_repeated()
                    ? reflection.MutableRepeatedMessage(message, field, std::stoi(step.second))
                    : reflection.MutableMessage(message, field);
    } else if (field->cpp_type() == Field::CPPTYPE_DOUBLE) {
      reflection.SetDouble(message, field, value);
    } else if (field->cpp_type() == Field::CPPTYPE_FLOAT) {
      reflection.SetFloat(message, field, static_cast<float>(value));
    } else if (field->cpp_type() == Field::CPPTYPE_INT32) {
      reflection.SetInt32(message, field, static_cast<std::int32_t>(value));
    } else {
      reflection.SetEnumValue(message, field, static_cast<int>(value));
    }
  }
}

struct WrongField {
  std::string path;
  std::vector<double> values;
  std::string named = {};  // in the error; empty: the path
};

// Each value alone makes the good request wrong, and the error names the field.
inline void ExpectNamed(const isoscope::v1::RenderIsosurfaceRequest& good,
                        const std::vector<WrongField>& fields) {
  ASSERT_THAT(FrameSpecFromProto(good), isoscope::testing::IsOk());
  for (const WrongField& field : fields) {
    for (const double value : field.values) {
      isoscope::v1::RenderIsosurfaceRequest request = good;
      SetField(field.path, value, &request);
      EXPECT_THAT(FrameSpecFromProto(request),
                  isoscope::testing::StatusIs(
                      absl::StatusCode::kInvalidArgument,
                      ::testing::HasSubstr(field.named.empty() ? field.path : field.named)))
          << value;
    }
  }
}

}  // namespace isoscope::wire

#endif  // ISOSCOPE_TESTS_UNIT_WIRE_WRONG_FIELDS_H_
