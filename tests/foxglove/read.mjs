// Reads an MCAP file as Foxglove does: by its index, every message by its schema. One JSON object on standard output:
// by topic the schema's name and how many messages there are, and what was complained about on the way.
import { open } from "node:fs/promises";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg-serialization";
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers, protobufFromBinaryDescriptor } from "@mcap/support";

const complaints = [];
for (const level of ["warn", "error"]) console[level] = (...words) => complaints.push(words.join(" "));

function decoderOf(schema, encoding) {
  if (encoding === "protobuf") {
    const type = protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);
    return data => type.decode(data);
  }
  if (encoding === "ros1") {
    const reader = new MessageReader(parse(new TextDecoder().decode(schema.data)));
    return data => reader.readMessage(data);
  }
  throw new Error(`${schema.name}: ${encoding} is not read`);
}

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, size) => {
    const bytes = new Uint8Array(Number(size));
    const { bytesRead } = await file.read(bytes, 0, bytes.length, Number(offset));
    if (bytesRead !== bytes.length) throw new Error(`${bytesRead} of ${size} bytes at ${offset}`);
    return bytes;
  },
};
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });
const decoders = new Map();
const topics = {};
let last = 0n;
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  if (!decoders.has(channel.id)) decoders.set(channel.id, decoderOf(schema, channel.messageEncoding));
  const content = decoders.get(channel.id)(message.data);
  const topic = (topics[channel.topic] ??= { schema: schema.name, messages: 0, fields: Object.keys(content) });
  topic.messages += 1;
  if (message.logTime < last) complaints.push(`${channel.topic}: ${message.logTime} comes after ${last}`);
  last = message.logTime;
}
const attachments = [];
for await (const attachment of reader.readAttachments()) attachments.push(attachment.name);
await file.close();
process.stdout.write(JSON.stringify({ topics, complaints, attachments }));
