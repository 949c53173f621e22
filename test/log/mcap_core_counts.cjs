// Counts the messages of an MCAP file by topic with @mcap/core, checksums on: `node mcap_core_counts.cjs FILE`.
const { open } = require("node:fs/promises");
const { McapIndexedReader } = require("@mcap/core");
const { decompress } = require("fzstd");

async function main(path) {
  const file = await open(path);
  const size = BigInt((await file.stat()).size);
  const readable = {
    size: async () => size,
    read: async (offset, length) => {
      const buffer = new Uint8Array(Number(length));
      await file.read(buffer, 0, Number(length), Number(offset));
      return buffer;
    },
  };
  const reader = await McapIndexedReader.Initialize({
    readable,
    decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
  });
  const counts = {};
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const topic = reader.channelsById.get(message.channelId).topic;
    counts[topic] = (counts[topic] ?? 0) + 1;
  }
  console.log(JSON.stringify(counts));
}

main(process.argv[2]);
