// A series of a folder, for people who choose one.

#ifndef ISOSCOPE_CORE_SOURCE_SERIES_ENTRY_H_
#define ISOSCOPE_CORE_SOURCE_SERIES_ENTRY_H_

#include <cstdint>
#include <string>

namespace isoscope::source {

struct SeriesEntry {
  std::string uid;
  std::int64_t number = 0;
  std::string description{};  // may be empty
  std::int64_t width = 0;     // of the first of its files
  std::int64_t height = 0;
  std::int64_t images = 0;  // files, or frames of all
  std::string first_file{};
  std::string folder{};  // the one below the listed folder that has all its files; "": that itself
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SERIES_ENTRY_H_
