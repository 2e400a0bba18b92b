// Arrays that zarr-python and numcodecs write: every type, both orders and byte orders, every codec
// that they have, keys of both kinds. What is read must have the bytes that NumPy has.

#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/zarr/zarr_series.h"
#include "core/formats/zarr/zarr_store.h"
#include "core/source/chunks/stored_array.h"
#include "tests/support/skips.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

const char* const kScript = R"(
import sys, itertools
import numpy, zarr, numcodecs
out = sys.argv[1]
random = numpy.random.RandomState(7)
root = zarr.open_group(out + "/all.zarr", mode="w")
names = []

def add(name, data, chunks, **options):
    array = root.create_dataset(name, shape=data.shape, dtype=data.dtype, chunks=chunks, **options)
    array[...] = data
    data = array[...]  # as lossy codecs leave it
    data.astype(data.dtype.newbyteorder("<")).tofile(out + "/" + name + ".raw")
    names.append(name)

def numbers(dtype, shape=(5, 7, 9)):
    kind = numpy.dtype(dtype)
    if kind.kind == "b":
        return random.rand(*shape) > 0.5
    if kind.kind == "f":
        return (random.randint(-1000, 1000, shape) / 8).astype(kind)
    low = 0 if kind.kind == "u" else -100
    return random.randint(low, 100, shape).astype(kind)

types = ["|b1", "|u1", "|i1"] + [o + t for o in "<>" for t in
         ("u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")]
for i, dtype in enumerate(types):
    for order in "CF":
        add("type%d%s" % (i, order), numbers(dtype), (2, 3, 4), order=order,
            compressor=numcodecs.Zlib(1), dimension_separator="./"[i % 2])
compressors = [None, numcodecs.GZip(3), numcodecs.Zlib(6), numcodecs.BZ2(2), numcodecs.LZ4(),
               numcodecs.Zstd(5), numcodecs.LZMA(), numcodecs.LZMA(format=2),
               numcodecs.LZMA(preset=1)]
compressors += [numcodecs.Blosc(cname=c, clevel=l, shuffle=s)
                for c in ("blosclz", "lz4", "lz4hc", "zlib", "zstd", "snappy")
                for l in (0, 5) for s in (0, 1, 2)]
for i, compressor in enumerate(compressors):
    add("codec%d" % i, numbers("<i2", (20, 30, 40)), (20, 16, 33), compressor=compressor)
filters = [[numcodecs.Delta("<i2")], [numcodecs.Delta("<i2", astype="<i4")],
           [numcodecs.Shuffle(2)], [numcodecs.CRC32()], [numcodecs.Adler32()],
           [numcodecs.FixedScaleOffset(offset=5, scale=3, dtype="<i2", astype="<i4")],
           [numcodecs.AsType(encode_dtype="<i4", decode_dtype="<i2")],
           [numcodecs.Delta("<i2"), numcodecs.Shuffle(2), numcodecs.CRC32()]]
for i, chain in enumerate(filters):
    for order in "CF":
        add("filter%d%s" % (i, order), numbers("<i2"), (2, 3, 4), filters=chain, order=order,
            compressor=numcodecs.Zstd(1))
reals = [[numcodecs.FixedScaleOffset(offset=-3, scale=10, dtype="<f8", astype="<i4")],
         [numcodecs.Quantize(digits=1, dtype="<f8")], [numcodecs.Delta(">f8")],
         [numcodecs.AsType(encode_dtype="<f4", decode_dtype="<f8")]]
for i, chain in enumerate(reals):
    add("real%d" % i, numbers(">f8" if i == 2 else "<f8"), (2, 3, 4), filters=chain)
for i, shape in enumerate([(5, 7, 9), (4, 4, 4)]):
    add("bits%d" % i, numbers("|b1", shape), (2, 3, 4), filters=[numcodecs.PackBits()])
for i, fill in enumerate([3, -7.5, float("nan"), float("inf"), None]):
    array = root.create_dataset("fill%d" % i, shape=(5, 7, 9), dtype="<f4", chunks=(2, 3, 4),
                                fill_value=fill)
    array[0:2] = 1
    data = numpy.full((5, 7, 9), 0 if fill is None else fill, "<f4")
    data[0:2] = 1
    data.tofile(out + "/fill%d.raw" % i)
    names.append("fill%d" % i)
zarr.consolidate_metadata(root.store)
open(out + "/names", "w").write("\n".join(names))
with zarr.ZipStore(out + "/all.zip", mode="w") as target:
    zarr.copy_store(root.store, target)
)";

class ZarrPythonTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string script = dir_.Write("write.py", kScript);
    // Debian's Python, which has Debian's modules.
    // NOLINTNEXTLINE(cert-env33-c,concurrency-mt-unsafe)
    if (std::system("/usr/bin/python3 -c 'import zarr, numcodecs' 2>/dev/null") != 0) {
      ISOSCOPE_SKIP("zarr", "python3-zarr is not installed");
    }
    // NOLINTNEXTLINE(cert-env33-c,concurrency-mt-unsafe)
    ASSERT_EQ(
        std::system(absl::StrCat("/usr/bin/python3 '", script, "' '", dir_.path(), "'").c_str()),
        0);
  }
  const testing::TempDir dir_;
};

TEST_F(ZarrPythonTest, ReadsWhatItWrites) {
  const std::vector<std::string> names = absl::StrSplit(testing::ReadFile(dir_.Sub("names")), '\n');
  ASSERT_GT(names.size(), 100U);
  for (const char* file : {"all.zarr", "all.zip"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenLocalZarr(dir_.Sub(file)));
    for (const std::string& name : names) {
      SCOPED_TRACE(absl::StrCat(file, ":", name));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrNode node, store->Node(name));
      ISOSCOPE_ASSERT_OK(node.array);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto array,
                                    OpenStoredArray(store->objects(), node.array->SpecOf(name)));
      const std::string expected = testing::ReadFile(dir_.Sub(name + ".raw"));
      std::string bytes(expected.size(), '?');
      ISOSCOPE_ASSERT_OK(
          array->ReadBox(BoxOf(array->info().dims), bytes.data(), nullptr, base::Cancellation()));
      EXPECT_TRUE(bytes == expected) << node.array->attributes;
    }
  }
}

// The consolidated metadata list the arrays; all lie on one grid or another.
TEST_F(ZarrPythonTest, OpensAnArrayAsAVolume) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto store, OpenLocalZarr(dir_.Sub("all.zarr")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenZarrSeries(std::move(store), "codec3", ""));
  ASSERT_EQ(series->info().fields.size(), 1U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{40, 30, 20}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, testing::ReadAll(*volume, 7));
  EXPECT_TRUE(samples == testing::ReadFile(dir_.Sub("codec3.raw")));
}

}  // namespace
}  // namespace isoscope::source
