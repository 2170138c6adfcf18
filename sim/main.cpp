#include <cstdio>
int main() { std::puts("rig-sim"); }
