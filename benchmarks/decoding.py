"""How fast the thesis's Transformer writes: with its cache, without, and beside Hugging Face.

    python benchmarks/decoding.py

Greedy decoding of 200 tokens by an untrained network of the thesis's size (section 5.4),
for one sentence and for several at once, in turns on one thread. The rivals:

- *prefix*: no cache; every step decodes what was written so far once more
- *thesis*: no cache, and always all 200 places, masked, as 4.2.3 describes it
- *transformers*: `generate` of Hugging Face's MarianMTModel with its cache, greedily, whose
  encoder and decoder have the same number of layers, heads, feed-forward units and words.
  Its width must be divisible by the heads: 48 in place of 50, so a little less work.

The encoder's work is counted for all. Prints one JSON object.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
import transformers
import tyro
from transformers import MarianConfig, MarianMTModel

from fusionnet.models.beam_search import Alphabet, decode
from fusionnet.models.transformer_config import thesis
from fusionnet.models.transformer_network import TransformerNetwork
from fusionnet.provenance import provenance

SOURCE_WORDS, TARGET_WORDS = 1200, 90
PADDING, START, END = 0, 2, 3


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to measure.

    Attributes:
        tokens: Tokens that are written.
        source: Tokens of each sentence.
        batches: How many sentences are decoded together.
        rounds: How often each is done; the fastest counts.
    """

    tokens: int = 200
    source: int = 13
    batches: tuple[int, ...] = (1, 8)
    rounds: int = 3


def fastest(rounds: int, ways: dict[str, Callable[[], Any]]) -> dict[str, float]:
    """Processor seconds of the fastest of some rounds of each way, done in turns."""
    seconds = dict.fromkeys(ways, float("inf"))
    for _ in range(rounds):
        for name, way in ways.items():
            begin = time.process_time()
            way()
            seconds[name] = min(seconds[name], time.process_time() - begin)
    return seconds


def ours() -> TransformerNetwork:
    """A network that never ends a sentence by itself."""
    torch.manual_seed(0)
    network = TransformerNetwork(thesis(SOURCE_WORDS, TARGET_WORDS)).eval()
    with torch.no_grad():
        network.output.bias[END] = -1e4
    return network


def rival(tokens: int) -> MarianMTModel:
    """Hugging Face's Transformer of the same size."""
    size = thesis(SOURCE_WORDS, TARGET_WORDS)
    torch.manual_seed(0)
    config = MarianConfig(
        vocab_size=SOURCE_WORDS,
        decoder_vocab_size=TARGET_WORDS,
        share_encoder_decoder_embeddings=False,
        tie_word_embeddings=False,
        d_model=size.model_size,
        encoder_layers=size.layers,
        decoder_layers=size.layers,
        encoder_attention_heads=size.heads,
        decoder_attention_heads=size.heads,
        encoder_ffn_dim=size.feed_forward_size,
        decoder_ffn_dim=size.feed_forward_size,
        max_position_embeddings=tokens + 1,
        activation_function="relu",
        scale_embedding=False,
        pad_token_id=PADDING,
        decoder_start_token_id=START,
        eos_token_id=END,
        forced_eos_token_id=None,
    )
    return MarianMTModel(config).eval()


@torch.inference_mode()
def uncached(network: TransformerNetwork, source: torch.Tensor, tokens: int, whole: bool) -> None:
    """Greedy decoding that decodes everything once more at every step."""
    memory = network.encode(source)
    given = torch.full((len(source), tokens), END)
    given[:, 0] = START
    for place in range(tokens):
        shown = given if whole else given[:, : place + 1]
        logits = network.output(network.decode(memory, shown)[:, place])
        if place + 1 < tokens:
            given[:, place + 1] = logits.argmax(-1)


def main(config: Config) -> None:
    """Measure, and print."""
    torch.set_num_threads(1)
    tokens = config.tokens
    network, other = ours(), rival(tokens)
    alphabet = Alphabet(TARGET_WORDS, START, END, PADDING)
    found: dict[str, Any] = {}
    for count in config.batches:
        source = torch.randint(4, SOURCE_WORDS, (count, config.source))

        def cached(source: torch.Tensor = source) -> None:
            with torch.inference_mode():
                memory = network.encode(source)
                decode(network, memory, alphabet, beam=1, count=1, longest=tokens - 1)

        def hugging(source: torch.Tensor = source) -> None:
            with torch.inference_mode():
                written = other.generate(
                    input_ids=source,
                    attention_mask=torch.ones_like(source),
                    min_new_tokens=tokens,
                    max_new_tokens=tokens,
                    num_beams=1,
                    do_sample=False,
                )
            assert written.shape[1] == tokens + 1, written.shape

        ways: dict[str, Callable[[], Any]] = {
            "cached": cached,
            "prefix": lambda s=source: uncached(network, s, tokens, False),
            "thesis": lambda s=source: uncached(network, s, tokens, True),
            "transformers": hugging,
        }
        for way in ways.values():
            way()
        seconds = fastest(config.rounds, ways)
        found[f"sentences_{count}"] = {
            "seconds": {name: round(s, 4) for name, s in seconds.items()},
            "times_as_fast_as": {
                name: round(s / seconds["cached"], 2)
                for name, s in seconds.items()
                if name != "cached"
            },
        }
    parameters = {
        "ours": sum(p.numel() for p in network.parameters()),
        "transformers": sum(p.numel() for p in other.parameters()),
    }
    document = {
        "tokens": tokens,
        "parameters": parameters,
        **found,
        "threads": torch.get_num_threads(),
        "transformers": transformers.__version__,
        **provenance(),
    }
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
