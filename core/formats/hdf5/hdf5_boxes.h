// Boxes of a dataset in any order, for datasets without a copy of its samples.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_BOXES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_BOXES_H_

#include <memory>
#include <string>

#include "core/source/child/walled_source.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Returns `rows`, which `library.open` opened for `path` and `part`, with boxes: box_grid() is always
// set, and has the chunks of the dataset. `library.describe` is called with `part`, a blank and a
// number, and returns the texts of ListHdf5Chunks from that chunk on; no texts: only the library can
// read it.
//
// Nothing is asked before the first box. Then this process reads and decodes chunks itself, on all
// threads. It does so for numbers of all their bits and filters that it knows (gzip, shuffle,
// Fletcher32, bzip2, Blosc, Zstandard), and for samples without chunks. Boxes of all else are read by
// the library, in a child of their own, one after the other; their grid has whole rows.
//
// ReadBox also: errors of ListHdf5Chunks and DescribeWalled; DATA_LOSS: a chunk lies outside of the
// file, or the child's answer makes no sense. NOT_FOUND, PERMISSION_DENIED: its file.
std::unique_ptr<VolumeSource> WithHdf5Boxes(std::unique_ptr<VolumeSource> rows,
                                            const WalledLibrary& library, const std::string& path,
                                            const std::string& part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_BOXES_H_
