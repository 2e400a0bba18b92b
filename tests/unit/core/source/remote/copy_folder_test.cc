#include "core/source/remote/copy_folder.h"

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "tests/support/folder_test.h"
#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/source/remote/remote_test.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

using testing::Answer;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::ScriptedServer;
using testing::ServedConnection;
using testing::ServedRequest;
using testing::StatusIs;

// A server of a bucket, without a signature, and of the same as an index.
class CopyFolderTest : public testing::FolderTest {
 protected:
  CopyFolderTest()
      : server_([this](const ServedRequest& request, ServedConnection* connection) {
          Serve(request, connection);
        }) {
    Put("run/.zgroup", "{}");
    Put("run/a/0", RemoteBytes(1000));
    Put("run/a/1 2", "");
    Put("run/large", RemoteBytes(9 * base::kMiB + 3));
    for (int i = 0; i < 40; ++i) {
      Put(absl::StrCat("run/b/", i), absl::StrCat("chunk ", i));
    }
    Put("runner", "another");
  }

  void Put(const std::string& key, std::string bytes, const std::string& etag = "\"0\"")
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    objects_[key] = {.bytes = std::move(bytes), .etag = etag};
  }

  // Requests for this key are answered with 404; none: for an empty key.
  void Deny(const std::string& key) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    denied_key_ = key;
  }

  // The answer for this key is half of it, whose head says so.
  void Cut(const std::string& key) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    cut_key_ = key;
  }

  void Serve(const ServedRequest& request, ServedConnection* connection)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const std::string target = absl::StrReplaceAll(request.target, {{"%20", " "}});
    const std::string key = absl::StartsWith(target, "/bucket/?") ? "" : target.substr(8);
    testing::ServedObject object;
    std::string other_answer;
    {
      const base::MutexLock lock(&mutex_);
      const auto found = objects_.find(key);
      if (found == objects_.end() || key == denied_key_ || key == cut_key_) {
        other_answer = AnswerWithoutObject(target, key);
      } else {
        object = found->second;
      }
    }
    if (!other_answer.empty()) {
      connection->Send(other_answer);
    } else {
      testing::ServeObject(object, request, connection);
    }
  }

  std::string AnswerWithoutObject(const std::string& target, const std::string& key) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (absl::StartsWith(target, "/bucket/?")) {
      std::string contents;
      for (const auto& [listed, object] : objects_) {
        if (absl::StartsWith(listed, "run/")) {
          absl::StrAppend(&contents, "<Contents><Key>", absl::StrReplaceAll(listed, {{" ", "+"}}),
                          "</Key><Size>", object.bytes.size(), "</Size></Contents>");
        }
      }
      return Answer(200, "",
                    absl::StrCat("<ListBucketResult><EncodingType>url</EncodingType>", contents,
                                 "<IsTruncated>false</IsTruncated></ListBucketResult>"));
    }
    if (!key.empty() && key == cut_key_) {
      const std::string& bytes = objects_.at(key).bytes;
      return Answer(200, "", bytes.substr(0, bytes.size() / 2));
    }
    std::set<std::string> names;
    if (key != denied_key_ && absl::EndsWith(target, "/")) {
      for (const auto& [other, object] : objects_) {
        if (absl::StartsWith(other, key)) {
          const std::string rest = other.substr(key.size());
          names.insert(rest.substr(
              0, rest.find('/') == std::string::npos ? rest.size() : rest.find('/') + 1));
        }
      }
    }
    std::string page;
    for (const std::string& name : names) {
      absl::StrAppend(&page, "<a href=\"", absl::StrReplaceAll(name, {{" ", "%20"}}), "\">x</a>");
    }
    return names.empty() ? Answer(404, "", "") : Answer(200, "", page);
  }

  absl::StatusOr<CopyReport> Copy(const std::string& address) {
    notes_.clear();
    RemoteOptions options = QuickOptions();
    options.s3.endpoint = server_.origin();
    options.s3.region = "eu-test-1";
    const base::Cancellation never;
    return CopyAddress(address, dir_.Sub("out"), options,
                       {.note = [this](const std::string& note) { notes_.push_back(note); }},
                       never);
  }

  void ExpectCopied(const std::string& name = "run") ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const base::MutexLock lock(&mutex_);
      for (const auto& [key, object] : objects_) {
        if (absl::StartsWith(key, "run/")) {
          const auto copied = io::ReadWholeFile(dir_.Sub("out/" + name + key.substr(3)), 1 << 30);
          ASSERT_THAT(copied.status(), testing::IsOk());
          EXPECT_TRUE(*copied == object.bytes) << key;
        }
      }
    }
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(dir_.Sub("out"))) {
      names.push_back(entry.path().filename().string());
    }
    EXPECT_THAT(names, ElementsAre(name));
  }

  std::vector<std::string> notes_;
  base::Mutex mutex_;
  std::map<std::string, testing::ServedObject> objects_ ABSL_GUARDED_BY(mutex_);
  std::string denied_key_ ABSL_GUARDED_BY(mutex_);
  std::string cut_key_ ABSL_GUARDED_BY(mutex_);
  // A copy that failed may leave requests behind: the server ends before what it refers to.
  ScriptedServer server_;
};

TEST_F(CopyFolderTest, CopiesWhatS3ListsBelowAPrefix) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy("s3://bucket/run/"));
  EXPECT_EQ(report.path, dir_.Sub("out/run"));
  EXPECT_EQ(report.object_count, 44);
  EXPECT_EQ(report.kept_bytes, 0);
  EXPECT_THAT(notes_, IsEmpty());
  ExpectCopied();
  EXPECT_THAT(Copy("s3://bucket/run/").status(), StatusIs(absl::StatusCode::kAlreadyExists));
}

// A small object is one request; that its body is whole is told by the list alone.
TEST_F(CopyFolderTest, ObjectsHaveTheSizesOfTheList) {
  Cut("run/a/0");
  EXPECT_THAT(
      Copy("s3://bucket/run/").status(),
      StatusIs(absl::StatusCode::kDataLoss,
               ::testing::AllOf(HasSubstr("run/a/0"), HasSubstr("1000 bytes, and has 500"))));
  EXPECT_FALSE(fs::exists(dir_.Sub("out/run")));
  Cut("");
  ISOSCOPE_ASSERT_OK(Copy("s3://bucket/run/"));
  ExpectCopied();
}

TEST_F(CopyFolderTest, APrefixNeedsNoSlash) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy("s3://bucket/run"));
  EXPECT_EQ(report.object_count, 44);
  ExpectCopied();
}

TEST_F(CopyFolderTest, CopiesWhatAnIndexLinksTo) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy(server_.origin() + "/bucket/run/"));
  EXPECT_EQ(report.object_count, 44);
  ExpectCopied();
}

TEST_F(CopyFolderTest, GoesOnWithWhatIsThereAndHasNotChanged) {
  Deny("run/b/39");
  EXPECT_THAT(Copy("s3://bucket/run/").status(), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_FALSE(fs::exists(dir_.Sub("out/run")));
  EXPECT_TRUE(fs::exists(dir_.Sub("out/run.part.record")));
  Deny("");
  Put("run/a/0", RemoteBytes(1001).substr(1), "\"1\"");  // of the same size
  const std::size_t before = server_.requests().size();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy("s3://bucket/run/"));
  EXPECT_GT(report.kept_bytes, 0);
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("copied again")));
  ExpectCopied();
  // Of a kept object only the first byte is asked for.
  int whole = 0;
  const auto requests = server_.requests();
  for (std::size_t i = before; i < requests.size(); ++i) {
    whole += requests[i].Header("range").empty() && !absl::StrContains(requests[i].target, "?");
  }
  EXPECT_LT(whole, 40);
}

TEST_F(CopyFolderTest, ARecordOfAnotherFolderIsNotGoneOnWith) {
  Deny("run/b/39");
  EXPECT_FALSE(Copy("s3://bucket/run/").ok());
  Deny("");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy(server_.origin() + "/bucket/run/"));
  EXPECT_EQ(report.kept_bytes, 0);
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("begins again")));
  ExpectCopied();
}

TEST_F(CopyFolderTest, AKeyThatIsFileAndFolderIsRefused) {
  Put("run/a", "file");
  EXPECT_THAT(Copy("s3://bucket/run/").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no disk can hold")));
}

TEST_F(CopyFolderTest, ANameIsTheLastPart) {
  EXPECT_EQ(*CopyNameOf(*ParseAddress("https://h/a/b%20c//")), "b c");
  EXPECT_EQ(*CopyNameOf(*ParseAddress("s3://bucket/")), "bucket");
  EXPECT_EQ(*CopyNameOf(*ParseAddress("s3://bucket/a/b.nrrd")), "b.nrrd");
  EXPECT_THAT(CopyNameOf(*ParseAddress("https://h/")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(CopyNameOf(*ParseAddress("https://h/a%2Fb")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::source
