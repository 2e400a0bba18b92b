#include "rpc/reflection_v1.h"

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_replace.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/descriptor.pb.h"
#include "grpc/reflection/v1/reflection.grpc.pb.h"
#include "grpc/reflection/v1/reflection.pb.h"
#include "gtest/gtest.h"
#include <grpcpp/generic/generic_stub.h>

#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

namespace reflection = grpc::reflection::v1;
using google::protobuf::DescriptorPool;
using google::protobuf::FileDescriptorProto;
using reflection::ServerReflectionRequest;
using reflection::ServerReflectionResponse;
using ::testing::Contains;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

constexpr absl::Duration kPatience = absl::Seconds(60);
constexpr char kV1[] = "grpc.reflection.v1.ServerReflection";
constexpr char kV1Alpha[] = "grpc.reflection.v1alpha.ServerReflection";
constexpr char kCluster[] = "isoscope.v1.ClusterService";

std::vector<std::string> NamesIn(const ServerReflectionResponse& response) {
  std::vector<std::string> names;
  for (const auto& service : response.list_services_response().service()) {
    names.push_back(service.name());
  }
  return names;
}

std::vector<FileDescriptorProto> FilesIn(const ServerReflectionResponse& response) {
  std::vector<FileDescriptorProto> files;
  for (const std::string& bytes : response.file_descriptor_response().file_descriptor_proto()) {
    EXPECT_TRUE(files.emplace_back().ParseFromString(bytes));
  }
  return files;
}

ServerReflectionRequest RequestForSymbol(const std::string& name) {
  ServerReflectionRequest request;
  request.set_file_containing_symbol(name);
  return request;
}

class ReflectionV1Test : public ::testing::Test {
 protected:
  void SetUp() override {
    EnableServerPlugins();
    grpc::ServerBuilder builder;
    ConfigureServer(&builder);
    AddReflectionV1(&builder);
    builder.RegisterService(&service_);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(running_, StartServer(&builder, /*listen_address=*/""));
    channel_ = running_.server->InProcessChannel(MakeChannelArguments());
    context_.set_deadline(base::MonotonicNow() + 10 * kPatience);  // of all requests together
    stream_ = reflection::ServerReflection::NewStub(channel_)->ServerReflectionInfo(&context_);
  }
  void TearDown() override {
    context_.TryCancel();
    stream_.reset();
    running_.server.reset();  // before the service
  }

  // The answer of version 1, all on one stream.
  ServerReflectionResponse Ask(const ServerReflectionRequest& request) {
    ServerReflectionResponse response;
    EXPECT_TRUE(stream_->Write(request));
    EXPECT_TRUE(stream_->Read(&response));
    EXPECT_EQ(response.original_request().SerializeAsString(), request.SerializeAsString());
    return response;
  }

  // The answer of gRPC's own service to the same bytes.
  ServerReflectionResponse AskV1Alpha(const ServerReflectionRequest& request) {
    grpc::TemplatedGenericStub<ServerReflectionRequest, ServerReflectionResponse> stub(channel_);
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kPatience);
    grpc::CompletionQueue queue;
    const auto call = stub.PrepareCall(
        &context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", &queue);
    void* tag = nullptr;
    bool ok = false;
    const auto wait = [&] { EXPECT_TRUE(queue.Next(&tag, &ok) && ok); };
    call->StartCall(nullptr);
    wait();
    call->WriteLast(request, grpc::WriteOptions(), nullptr);
    wait();
    ServerReflectionResponse response;
    call->Read(&response, nullptr);
    wait();
    grpc::Status status;
    call->Finish(&status, nullptr);
    wait();
    EXPECT_THAT(ToAbslStatus(status), IsOk());
    return response;
  }

  isoscope::v1::ClusterService::CallbackService service_;
  RunningServer running_;
  std::shared_ptr<grpc::Channel> channel_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<ServerReflectionRequest, ServerReflectionResponse>>
      stream_;
};

TEST_F(ReflectionV1Test, BothVersionsListBothAndTheServices) {
  ServerReflectionRequest request;
  request.set_list_services("");
  for (const ServerReflectionResponse& response : {Ask(request), AskV1Alpha(request)}) {
    for (const char* name : {kV1, kV1Alpha, kCluster}) {
      EXPECT_THAT(NamesIn(response), Contains(name));
    }
  }
}

TEST_F(ReflectionV1Test, WhatIsListedIsDescribedByBothVersions) {
  for (const char* name : {kV1, kV1Alpha, kCluster}) {
    const ServerReflectionRequest request = RequestForSymbol(name);
    std::vector<FileDescriptorProto> files = FilesIn(Ask(request));
    ASSERT_FALSE(files.empty()) << name;
    EXPECT_THAT(name, HasSubstr(files[0].package()));
    EXPECT_EQ(files.size(), FilesIn(AskV1Alpha(request)).size()) << name;
    // A tool builds imports before the files that have them.
    DescriptorPool pool;
    std::reverse(files.begin(), files.end());
    int built_count = 0;
    for (std::size_t round = 0; round < files.size(); ++round) {
      for (const FileDescriptorProto& file : files) {
        const bool has_imports =
            std::all_of(file.dependency().begin(), file.dependency().end(),
                        [&](const std::string& i) { return pool.FindFileByName(i) != nullptr; });
        if (has_imports && pool.FindFileByName(file.name()) == nullptr) {
          built_count += pool.BuildFile(file) != nullptr ? 1 : 0;
        }
      }
    }
    EXPECT_EQ(built_count, static_cast<int>(files.size()))
        << "imports lack, or a file came twice: " << name;
    EXPECT_NE(pool.FindServiceByName(name), nullptr);
  }
}

TEST_F(ReflectionV1Test, FilesAndExtensionsAreFoundAsByV1Alpha) {
  const std::string file_name = "isoscope/v1/options.proto";
  const auto* const file = DescriptorPool::generated_pool()->FindFileByName(file_name);
  ASSERT_NE(file, nullptr);
  ASSERT_GT(file->extension_count(), 0);
  const auto* const extension = file->extension(0);
  const std::string extended = extension->containing_type()->full_name();

  ServerReflectionRequest by_name;
  by_name.set_host("a.example");
  by_name.set_file_by_filename(file_name);
  const ServerReflectionResponse named = Ask(by_name);
  ASSERT_FALSE(FilesIn(named).empty());
  EXPECT_EQ(FilesIn(named)[0].name(), file_name);
  EXPECT_EQ(named.valid_host(), "a.example");

  ServerReflectionRequest by_extension;
  by_extension.mutable_file_containing_extension()->set_containing_type(extended);
  by_extension.mutable_file_containing_extension()->set_extension_number(extension->number());
  const ServerReflectionResponse extending = Ask(by_extension);
  ASSERT_FALSE(FilesIn(extending).empty());
  EXPECT_EQ(FilesIn(extending)[0].name(), file_name);
  EXPECT_EQ(FilesIn(AskV1Alpha(by_extension)).size(), FilesIn(extending).size());

  ServerReflectionRequest numbers;
  numbers.set_all_extension_numbers_of_type(extended);
  const reflection::ExtensionNumberResponse answer = Ask(numbers).all_extension_numbers_response();
  EXPECT_EQ(answer.base_type_name(), extended);
  EXPECT_THAT(answer.extension_number(), Contains(extension->number()));
  EXPECT_EQ(answer.extension_number_size(),
            AskV1Alpha(numbers).all_extension_numbers_response().extension_number_size());
}

TEST_F(ReflectionV1Test, WhatIsNotThereIsAnErrorAndTheStreamGoesOn) {
  std::vector<ServerReflectionRequest> requests(5);
  requests[0].set_file_by_filename("../../etc/passwd");
  requests[1].set_file_containing_symbol("isoscope.v1.NoSuchService");
  requests[2].mutable_file_containing_extension()->set_containing_type("no.such.Message");
  requests[3].mutable_file_containing_extension()->set_containing_type("isoscope.v1.Camera");
  requests[3].mutable_file_containing_extension()->set_extension_number(7);
  requests[4].set_all_extension_numbers_of_type("no.such.Message");
  for (const ServerReflectionRequest& request : requests) {
    const auto error = Ask(request).error_response();
    EXPECT_EQ(error.error_code(), grpc::StatusCode::NOT_FOUND) << request.ShortDebugString();
    EXPECT_FALSE(error.error_message().empty());
    EXPECT_EQ(AskV1Alpha(request).error_response().error_code(), error.error_code());
  }
  EXPECT_EQ(Ask({}).error_response().error_code(), grpc::StatusCode::UNIMPLEMENTED);
  EXPECT_EQ(AskV1Alpha({}).error_response().error_code(), grpc::StatusCode::UNIMPLEMENTED);
  EXPECT_FALSE(FilesIn(Ask(RequestForSymbol(kCluster))).empty());
  stream_->WritesDone();
  EXPECT_THAT(ToAbslStatus(stream_->Finish()), IsOk());
}

TEST_F(ReflectionV1Test, MessagesAreThoseOfV1AlphaButForThePackage) {
  FileDescriptorProto v1 = FilesIn(Ask(RequestForSymbol(kV1)))[0];
  FileDescriptorProto alpha = FilesIn(Ask(RequestForSymbol(kV1Alpha)))[0];
  for (FileDescriptorProto* file : {&v1, &alpha}) {
    file->clear_name();
    file->clear_options();
  }
  EXPECT_EQ(v1.DebugString(),
            absl::StrReplaceAll(alpha.DebugString(), {{"reflection.v1alpha", "reflection.v1"}}));
}

TEST_F(ReflectionV1Test, AStreamHasALimitOfRequests) {
  ServerReflectionRequest request;
  request.set_list_services("");
  for (std::int64_t i = 0; i < kMaxReflectionRequests; ++i) {
    ASSERT_FALSE(NamesIn(Ask(request)).empty()) << i;
  }
  ServerReflectionResponse response;
  stream_->Write(request);
  EXPECT_FALSE(stream_->Read(&response));
  EXPECT_THAT(ToAbslStatus(stream_->Finish()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("open another")));
}

TEST_F(ReflectionV1Test, AShutdownEndsAnOpenStream) {
  Ask(RequestForSymbol(kCluster));
  running_.server->Shutdown(base::MonotonicNow());  // waits for all calls
  ServerReflectionResponse response;
  EXPECT_FALSE(stream_->Read(&response));
  EXPECT_FALSE(stream_->Finish().ok());
}

}  // namespace
}  // namespace isoscope::rpc
