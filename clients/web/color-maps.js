// The colour maps of the pictures, for legends: 33 colours at equal distances, interpolated
// linearly. The same as in core/picture/color_map.cc (tests/clients/web compares them).
// @ts-check

/** @type {Record<string, string[]>} */
export const COLOR_MAP_POINTS = {
  viridis: [
    '#440154', '#470d60', '#48186a', '#482374', '#472d7b', '#453681', '#424086', '#3f4989', '#3b528b', '#375a8d', '#33638d',
    '#2f6a8e', '#2c728e', '#297a8e', '#26818e', '#23898e', '#21908d', '#1f988b', '#1e9f88', '#21a685', '#27ae80', '#31b57b',
    '#3dbc74', '#4cc26c', '#5cc963', '#6ece58', '#81d44c', '#96d840', '#abdc32', '#c0df24', '#d5e219', '#eae519', '#fde725',
  ],
  magma: [
    '#000004', '#030311', '#0a0822', '#130d33', '#1d1146', '#28125a', '#36106b', '#430f76', '#50127c', '#5d177f', '#691c81',
    '#762181', '#822682', '#8f2a81', '#9c2e7f', '#a9327d', '#b6377a', '#c33b75', '#d04170', '#db486a', '#e65063', '#ef5c5e',
    '#f5695b', '#f9785c', '#fc8761', '#fd9668', '#fea571', '#feb47b', '#fec387', '#fed194', '#fde0a1', '#fceeb0', '#fcfdbf',
  ],
  cividis: [
    '#00224e', '#00285b', '#002e6b', '#043372', '#1c386f', '#273e6e', '#32436d', '#3b496c', '#434e6c', '#4b546c', '#52596d',
    '#5a5f6e', '#61646f', '#686a71', '#6f7073', '#757676', '#7c7b78', '#848179', '#8b8778', '#938d78', '#9b9376', '#a39a75',
    '#aba072', '#b3a670', '#bbad6d', '#c3b469', '#ccba64', '#d4c15f', '#ddc958', '#e6d051', '#efd748', '#f9df3b', '#fee838',
  ],
  turbo: [
    '#30123b', '#3a2a74', '#4040a2', '#4556c7', '#476be4', '#477ff7', '#4393ff', '#37a8fb', '#29bbec', '#1ccdd8', '#17dcc3',
    '#1de8b0', '#30f299', '#4cf97e', '#6bfe63', '#8aff4c', '#a3fd3c', '#b8f734', '#cced34', '#dee037', '#edd03a', '#f8c03a',
    '#fdae35', '#fe982c', '#fc8022', '#f56817', '#ec520e', '#e14009', '#d23105', '#c12302', '#ac1701', '#950c01', '#7a0403',
  ],
  'cool-warm': [
    '#3b4cc0', '#445acc', '#4e68d7', '#5875e1', '#6282ea', '#6c8ef1', '#779af7', '#82a5fb', '#8db0fe', '#98b9ff', '#a3c2ff',
    '#aec9fd', '#b8d0f9', '#c2d5f4', '#ccd9ee', '#d5dbe6', '#dddddd', '#e5d9d1', '#ecd3c6', '#f1ccb9', '#f5c4ad', '#f7bba0',
    '#f8b194', '#f7a687', '#f59a7b', '#f18d6f', '#ec7f63', '#e57057', '#de614c', '#d55042', '#cb3e38', '#c02a2f', '#b40426',
  ],
  grey: ['#000000', '#ffffff'],
};
