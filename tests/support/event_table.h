// A state machine's test as a table: the events that it is told, and the answers that they give.
//
//   begin     -> begin 0.0
//   0.0 hits  -> reduce,
//                step occluders
//   [step 2]
//
// A line without an arrow continues the answer before it. One in brackets is an event that gives no
// answer.

#ifndef ISOSCOPE_TESTS_SUPPORT_EVENT_TABLE_H_
#define ISOSCOPE_TESTS_SUPPORT_EVENT_TABLE_H_

#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "gtest/gtest.h"

namespace isoscope::testing {

// Tells the events in order, and expects the answers of the table.
inline void CheckEvents(absl::string_view table,
                        absl::FunctionRef<std::string(const std::string& event)> tell) {
  std::vector<std::pair<std::string, std::string>> rows;
  for (absl::string_view line : absl::StrSplit(table, '\n')) {
    line = absl::StripAsciiWhitespace(line);
    const std::vector<absl::string_view> columns = absl::StrSplit(line, "->");
    if (columns.size() == 2) {
      rows.emplace_back(absl::StripAsciiWhitespace(columns[0]),
                        absl::StripAsciiWhitespace(columns[1]));
    } else if (absl::StartsWith(line, "[")) {
      rows.emplace_back(line, "");
    } else if (!line.empty()) {
      absl::StrAppend(&rows.back().second, " ", line);
    }
  }
  ASSERT_FALSE(rows.empty()) << table;
  for (const auto& [event, answer] : rows) {
    EXPECT_EQ(tell(event), answer) << event << ", in" << table;
  }
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_EVENT_TABLE_H_
