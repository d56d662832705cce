"""Tables of BRDFs (Mallett & Yuksel 2016): where their samples lie, how they are chosen, stored and reconstructed."""
