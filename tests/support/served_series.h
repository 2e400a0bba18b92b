// A dataset with fields and time steps, as a coordinator describes it.

#ifndef ISOSCOPE_TESTS_SUPPORT_SERVED_SERIES_H_
#define ISOSCOPE_TESTS_SUPPORT_SERVED_SERIES_H_

#include <initializer_list>
#include <string>

#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "isoscope/v1/dataset.pb.h"

namespace isoscope::testing {

inline void AddField(isoscope::v1::Dataset* dataset, const std::string& name,
                     std::initializer_list<const char*> components,
                     std::initializer_list<int> steps) {
  isoscope::v1::Field& field = *dataset->add_fields();
  field.set_name(name);
  for (const char* const component : components) {
    field.add_components()->set_name(component);
  }
  for (const int step : steps) {
    field.add_time_steps(step);
  }
}

// Four steps, of which the agents have no number 1; velocity lags by one.
inline isoscope::v1::Dataset MakeSeries() {
  isoscope::v1::Dataset dataset;
  for (const int number : {0, 2, 3, 4}) {
    isoscope::v1::TimeStep& step = *dataset.add_time_steps();
    step.set_number(number);
    step.set_value(number * 0.5);
  }
  AddField(&dataset, "pressure", {""}, {0, 1, 2, 3});
  AddField(&dataset, "velocity", {"x", "y", "z", "magnitude"}, {0, 1, 2});
  return dataset;
}

inline isoscope::v1::FieldSelection Selection(const std::string& text) {
  isoscope::v1::FieldSelection selection;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &selection)) << text;
  return selection;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_SERVED_SERIES_H_
