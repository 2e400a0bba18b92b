#include "core/source/bytes/natural_order.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/ascii.h"

namespace isoscope::source {

bool NaturalLess(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); };
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto end_of = [&](const std::string& text, std::size_t at) {
        while (at < text.size() && is_digit(text[at])) {
          ++at;
        }
        return at;
      };
      const std::size_t a_end = end_of(a, i);
      const std::size_t b_end = end_of(b, j);
      const std::size_t a_first = std::min(a.find_first_not_of('0', i), a_end);
      const std::size_t b_first = std::min(b.find_first_not_of('0', j), b_end);
      if (a_end - a_first != b_end - b_first) {
        return a_end - a_first < b_end - b_first;
      }
      const int order = a.compare(a_first, a_end - a_first, b, b_first, b_end - b_first);
      if (order != 0) {
        return order < 0;
      }
      i = a_end;
      j = b_end;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i;
      ++j;
    }
  }
  if ((i < a.size()) != (j < b.size())) {
    return j < b.size();
  }
  return a < b;  // equal but for zeros in front
}

}  // namespace isoscope::source
