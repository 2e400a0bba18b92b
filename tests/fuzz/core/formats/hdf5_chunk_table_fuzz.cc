// What the child of HDF5 says of chunks, which may have been overrun: a text a line, an answer up to an
// empty line. A table that is complete is one that boxes can be read by.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"

#include "core/formats/hdf5/hdf5_chunk_table.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

void CheckTable(const source::Hdf5ChunkTable& table) {
  const std::size_t rank = table.dims.size();
  Require(rank >= 3 && table.start.size() == rank && table.space[2] < rank, "axes fit");
  Require(!table.file.empty() && table.plain_offset >= 0, "there is a file");
  for (std::size_t axis = 0; axis < rank; ++axis) {
    Require(table.start[axis] >= 0 && table.start[axis] < table.dims[axis], "the index is inside");
  }
  if (table.layout != source::Hdf5Storage::kChunks) {
    Require(table.chunks.empty(), "others have no chunks");
    return;
  }
  const auto counts = table.counts();
  Require(static_cast<std::int64_t>(table.chunks.size()) == counts[0] * counts[1] * counts[2],
          "each chunk is there");
  for (const source::Hdf5TableChunk& chunk : table.chunks) {
    Require(chunk.offset >= 0, "offsets are positive");
    Require(chunk.size > 0 || table.fill.size() == SizeOf(table.type.type),
            "what was never written is filled");
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  return {
      "layout=chunks\nfile=/data/run.h5\ndims=5 8 4 6\nspace=1 2 3\nstart=3 0 0 0\nchunk=1 4 4 5\n"
      "type=>i2\nfilter=2 2\nfilter=1 4\nfill=0102\nchunks=1000 1a4 0,-,2000 5 1,fffffffffff 1 0",
      "layout=chunks\nfile=f\ndims=4 4 4\nspace=0 1 2\nstart=0 0 0\nchunk=2 4 4\ntype=<f4\n"
      "chunks=10 100 0\n\nchunks=110 100 0",
      "layout=plain\nfile=f\ndims=3 4 5 2\nspace=0 1 2\nstart=0 0 0 1\ntype=<u1\noffset=2048",
      "layout=other\nfile=f\ndims=3 4 5\nspace=0 1 2\nstart=0 0 0\nchunk=3 4 5"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope;
  const std::string text(reinterpret_cast<const char*>(data), size);
  source::Hdf5ChunkTable table;
  bool is_complete = false;
  const std::vector<std::string> answers = absl::StrSplit(text, "\n\n");
  for (std::size_t i = 0; i < answers.size() && !is_complete; ++i) {
    if (!source::AddHdf5Chunks(absl::StrSplit(answers[i], '\n'), &table, &is_complete)) {
      return 0;
    }
  }
  if (is_complete) {
    fuzz::CheckTable(table);
  }
  return 0;
}
