// FITS files of known cards.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ARRAYS_FITS_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ARRAYS_FITS_BYTES_H_

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

namespace isoscope::testing {

// A part: cards of 80 characters, END, and samples, both filled up to blocks.
inline std::string FitsPartBytes(const std::vector<std::string>& cards,
                                 const std::string& samples) {
  std::string bytes;
  for (std::string card : cards) {
    card.resize(80, ' ');
    bytes += card;
  }
  bytes += "END";
  bytes.resize((bytes.size() + 2879) / 2880 * 2880, ' ');
  bytes += samples;
  bytes.resize((bytes.size() + 2879) / 2880 * 2880, '\0');
  return bytes;
}

// The cards of an image of 4 x 3 x 2 samples; `more` stands in front of END.
inline std::vector<std::string> FitsCubeCards(int bits, const std::vector<std::string>& more = {},
                                              const std::string& first = "SIMPLE  = T") {
  std::vector<std::string> cards = {first,         absl::StrCat("BITPIX  = ", bits),
                                    "NAXIS   = 3", "NAXIS1  = 4 / fastest",
                                    "NAXIS2  = 3", "NAXIS3  = 2"};
  cards.insert(cards.end(), more.begin(), more.end());
  return cards;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ARRAYS_FITS_BYTES_H_
