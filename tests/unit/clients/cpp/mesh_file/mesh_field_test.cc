#include "clients/cpp/mesh_file/mesh_field.h"

#include "absl/strings/str_join.h"
#include "gtest/gtest.h"

namespace isoscope::client {
namespace {

TEST(MeshFieldTest, EachFactIsALine) {
  const struct {
    MeshField field;
    const char* text;
  } cases[] = {
      {{.name = "pressure"}, "field pressure"},
      {{.name = "velocity",
        .component = "x",
        .unit = "m/s",
        .step = 3,
        .time = 0.1,
        .time_unit = "s"},
       "field velocity:x; unit m/s; step 3; time 0.1 s"},
      {{.name = "heat", .step = 0, .time = -1e300}, "field heat; step 0; time -1e+300"},
      {{.name = "a\nend_header\x7f",
        .unit = "\xc2\xb0"
                "C\t"},
       "field a?end_header?; unit \xc2\xb0"
       "C?"},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(absl::StrJoin(LinesOf(c.field), "; "), c.text);
  }
}

}  // namespace
}  // namespace isoscope::client
