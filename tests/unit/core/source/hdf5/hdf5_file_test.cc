#include "core/source/hdf5/hdf5_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/file.h>

#include "core/formats/hdf5/hdf5_source.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::isoscope::testing::WriteHdf5Dataset;
using ::testing::AllOf;
using ::testing::HasSubstr;

class Hdf5FileTest : public ::testing::Test {
 protected:
  // Writes a file of the newest format and leaves it open.
  Hdf5Handle Create() {
    const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_libver_bounds(access.get(), H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
    Hdf5Handle file(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.get()), H5Fclose);
    const std::string samples(24, 'a');
    WriteHdf5Dataset(file.get(), "v", {2, 3, 4}, H5T_STD_U8LE, samples.data());
    H5Fflush(file.get(), H5F_SCOPE_GLOBAL);
    return file;
  }
  const TempDir dir_;
  const std::string path_ = dir_.Sub("a.h5");
};

TEST_F(Hdf5FileTest, OpensAClosedFile) {
  Create();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Hdf5Handle file, OpenHdf5File(path_));
  EXPECT_TRUE(file.is_valid());
}

// The file is opened in another process, as the lock of this one does not hold against itself.
TEST_F(Hdf5FileTest, LockedFileSaysSoAndWhatToDo) {
  Create();
  const int descriptor = open(path_.c_str(), O_RDWR);
  ASSERT_EQ(flock(descriptor, LOCK_EX), 0);
  EXPECT_THAT(OpenVolumeFile(path_).status(),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(path_ + ": locked by a program that writes it: wait"),
                             HasSubstr("h5clear --status COPY"))));
  close(descriptor);
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(path_).status());
}

TEST_F(Hdf5FileTest, FileThatIsBeingWrittenOrWasNotClosedSaysSo) {
  std::string marked;
  {
    const Hdf5Handle file = Create();
    marked = ReadFile(path_);
  }
  WriteFile(dir_.Sub("marked.h5"), marked);
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("marked.h5")).status(),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr("marked.h5: marked as open for writing"),
                             HasSubstr("ended before it closed it"), HasSubstr("h5clear"))));
}

TEST_F(Hdf5FileTest, FileSystemWithoutLocksIsAnotherCase) {
  EXPECT_THAT(
      Hdf5OpenError("a.h5",
                    "unable to lock file, errno = 38, error message = 'Function "
                    "not implemented'"),
      StatusIs(absl::StatusCode::kUnavailable,
               AllOf(HasSubstr("gives no lock"), HasSubstr("HDF5_USE_FILE_LOCKING=FALSE"))));
}

TEST_F(Hdf5FileTest, CutFileIsNoFileOfAnotherKind) {
  Create();
  const std::string whole = ReadFile(path_);
  WriteFile(path_, whole.substr(0, whole.size() - 10));
  EXPECT_THAT(OpenHdf5File(path_).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("it is cut")));
  WriteFile(path_, std::string("\x0e\x03\x13\x01", 4) + "rest");
  EXPECT_THAT(OpenHdf5File(path_).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("a.h5: HDF4"), HasSubstr("h4toh5"))));
  WriteFile(path_, "whatever");
  EXPECT_THAT(OpenHdf5File(path_).status(), StatusIs(absl::StatusCode::kInvalidArgument,
                                                     HasSubstr("no HDF5 file, or it is damaged")));
  EXPECT_THAT(OpenHdf5File(dir_.Sub("none.h5")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no such file")));
}

}  // namespace
}  // namespace isoscope::source
