// The datasets of an HDF5 file. Calls the library: for the process that it runs in
// (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_LISTING_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_LISTING_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/formats/hdf5/hdf5_types.h"
#include "hdf5.h"

namespace isoscope::source {

// A dataset, or a name without one: a link that leads nowhere, sources that are no files.
struct Hdf5Entry {
  std::string name;                  // "/entry/data"
  std::vector<std::int64_t> dims{};  // slowest first
  std::string type{};                // Hdf5TypeName
  std::string filters{};             // DescribeHdf5Filters
  bool is_plain = false;             // IsPlainHdf5Type
  bool is_samples = false;           // of a type of Hdf5SampleTypeOf
  std::string missing{};             // why its samples are out of reach
};

// All datasets that the links of a file or group lead to, soft and external ones too, each once, by
// name, 10 000 at most. MATLAB's texts, empty arrays and internal groups ("#refs#") are left out.
std::vector<Hdf5Entry> ListHdf5Entries(hid_t file);

// Returns true if a path may name the dataset as a volume: samples with three axes or more, none
// empty; with `axes` above 0, of so many.
bool IsHdf5Volume(const Hdf5Entry& entry, std::size_t axes = 0);

// "/a (10 x 11 x 12 uint16, gzip), /u (5 x 10 x 11 x 12 float32)": those that are volumes, 50 at
// most; without any, what there is instead. The text is to follow "it holds ".
std::string DescribeHdf5Entries(const std::vector<Hdf5Entry>& entries);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_LISTING_H_
