"""Messages and stubs made by tools/regenerate_proto.sh. Private: no part of the API."""
