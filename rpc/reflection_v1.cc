// Answers from the descriptors of this program (DescriptorPool::generated_pool), as gRPC's own
// service of version 1alpha does. The names of services are those of the server.
//
// A plugin registers the service, because only plugins see that list. The server then owns the
// service. The program has the descriptor of version 1 by its generated code, so that version
// 1alpha describes it, too: tools that describe all services they find do not stumble.
//
// A stream alternates: a read, its answer, the next read. A call that is silent for long is
// cancelled, and has a limited number of requests.

#include "rpc/reflection_v1.h"

#include <cstddef>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/descriptor.pb.h"
#include "grpc/reflection/v1/reflection.grpc.pb.h"
#include "grpc/reflection/v1/reflection.pb.h"
#include <grpcpp/impl/server_builder_option.h>
#include <grpcpp/impl/server_builder_plugin.h>
#include <grpcpp/impl/server_initializer.h>
#include <grpcpp/support/server_callback.h>
#include <grpcpp/support/status.h>

#include "rpc/write_timeout.h"

namespace isoscope::rpc {
namespace {

namespace reflection = grpc::reflection::v1;

using google::protobuf::DescriptorPool;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using reflection::ServerReflectionRequest;
using reflection::ServerReflectionResponse;

constexpr absl::Duration kMaxSilence = absl::Minutes(1);

const DescriptorPool& Pool() { return *DescriptorPool::generated_pool(); }

void SetError(grpc::StatusCode code, absl::string_view message,
              ServerReflectionResponse* response) {
  response->mutable_error_response()->set_error_code(code);
  response->mutable_error_response()->set_error_message(std::string(message));
}

// Answers with `file` and all that it imports; null: NOT_FOUND.
void SetFile(const FileDescriptor* file, absl::string_view asked,
             ServerReflectionResponse* response) {
  if (file == nullptr) {
    SetError(grpc::StatusCode::NOT_FOUND, absl::StrCat("this program knows no such ", asked),
             response);
    return;
  }
  std::vector<const FileDescriptor*> files = {file};
  std::set<const FileDescriptor*> seen = {file};
  for (std::size_t i = 0; i < files.size(); ++i) {
    google::protobuf::FileDescriptorProto proto;
    files[i]->CopyTo(&proto);
    response->mutable_file_descriptor_response()->add_file_descriptor_proto(
        proto.SerializeAsString());
    for (int j = 0; j < files[i]->dependency_count(); ++j) {
      if (seen.insert(files[i]->dependency(j)).second) {
        files.push_back(files[i]->dependency(j));
      }
    }
  }
}

const FileDescriptor* FileOf(const reflection::ExtensionRequest& request) {
  const auto* const type = Pool().FindMessageTypeByName(request.containing_type());
  const auto* const extension =
      type == nullptr ? nullptr : Pool().FindExtensionByNumber(type, request.extension_number());
  return extension == nullptr ? nullptr : extension->file();
}

void SetExtensions(const std::string& name, ServerReflectionResponse* response) {
  const auto* const type = Pool().FindMessageTypeByName(name);
  if (type == nullptr) {
    SetError(grpc::StatusCode::NOT_FOUND, "this program knows no such message", response);
    return;
  }
  reflection::ExtensionNumberResponse* const numbers =
      response->mutable_all_extension_numbers_response();
  numbers->set_base_type_name(name);
  std::vector<const FieldDescriptor*> extensions;
  Pool().FindAllExtensions(type, &extensions);
  for (const FieldDescriptor* const extension : extensions) {
    numbers->add_extension_number(extension->number());
  }
}

// `services`: the names of all services of the server.
ServerReflectionResponse Answer(const ServerReflectionRequest& request,
                                const std::vector<std::string>& services) {
  ServerReflectionResponse response;
  response.set_valid_host(request.host());
  *response.mutable_original_request() = request;
  switch (request.message_request_case()) {
    case ServerReflectionRequest::kFileByFilename:
      SetFile(Pool().FindFileByName(request.file_by_filename()), "file", &response);
      break;
    case ServerReflectionRequest::kFileContainingSymbol:
      SetFile(Pool().FindFileContainingSymbol(request.file_containing_symbol()), "symbol",
              &response);
      break;
    case ServerReflectionRequest::kFileContainingExtension:
      SetFile(FileOf(request.file_containing_extension()), "extension", &response);
      break;
    case ServerReflectionRequest::kAllExtensionNumbersOfType:
      SetExtensions(request.all_extension_numbers_of_type(), &response);
      break;
    case ServerReflectionRequest::kListServices:
      response.mutable_list_services_response();
      for (const std::string& service : services) {
        response.mutable_list_services_response()->add_service()->set_name(service);
      }
      break;
    case ServerReflectionRequest::MESSAGE_REQUEST_NOT_SET:
      SetError(grpc::StatusCode::UNIMPLEMENTED, "the request asks nothing that is known here",
               &response);
      break;
  }
  return response;
}

// One stream. Deletes itself when it is done.
class ReflectionCall final
    : public grpc::ServerBidiReactor<ServerReflectionRequest, ServerReflectionResponse> {
 public:
  // `services` outlives the call.
  ReflectionCall(grpc::CallbackServerContext* context, const std::vector<std::string>* services)
      : services_(*services), timeout_(context) {
    timeout_.Start(kMaxSilence);
    StartRead(&request_);
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      Finish(grpc::Status::OK);
      return;
    }
    if (++request_count_ > kMaxReflectionRequests) {
      Finish({grpc::StatusCode::RESOURCE_EXHAUSTED,
              absl::StrCat("this stream had ", kMaxReflectionRequests,
                           " requests, the most that one may have: open another")});
      return;
    }
    response_ = Answer(request_, services_);
    timeout_.Start(kMaxSilence);
    StartWrite(&response_);
  }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      Finish(grpc::Status::CANCELLED);
      return;
    }
    timeout_.Start(kMaxSilence);
    StartRead(&request_);
  }

  void OnDone() override {
    timeout_.Stop();
    delete this;
  }

 private:
  const std::vector<std::string>& services_;
  WriteTimeout timeout_;
  ServerReflectionRequest request_;
  ServerReflectionResponse response_;
  std::int64_t request_count_ = 0;
};

class ReflectionService final : public reflection::ServerReflection::CallbackService {
 public:
  // `services`: those of the server, which owns the list and this.
  explicit ReflectionService(const std::vector<std::string>* services) : services_(services) {}

  grpc::ServerBidiReactor<ServerReflectionRequest, ServerReflectionResponse>* ServerReflectionInfo(
      grpc::CallbackServerContext* context) override {
    return new ReflectionCall(context, services_);
  }

 private:
  const std::vector<std::string>* const services_;
};

class ReflectionPlugin final : public grpc::ServerBuilderPlugin {
 public:
  std::string name() override { return "isoscope_reflection_v1"; }
  void InitServer(grpc::ServerInitializer* server) override {
    server->RegisterService(std::make_shared<ReflectionService>(server->GetServiceList()));
  }
  void Finish(grpc::ServerInitializer* /*server*/) override {}
  void ChangeArguments(const std::string& /*name*/, void* /*value*/) override {}
};

class ReflectionOption final : public grpc::ServerBuilderOption {
 public:
  void UpdateArguments(grpc::ChannelArguments* /*arguments*/) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    plugins->push_back(std::make_unique<ReflectionPlugin>());
  }
};

}  // namespace

void AddReflectionV1(grpc::ServerBuilder* builder) {
  builder->SetOption(std::make_unique<ReflectionOption>());
}

}  // namespace isoscope::rpc
